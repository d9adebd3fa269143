"""A user's own robot: the documented example drives, ours as folders are ours, and every mistake
raises an error with file, field and valid values."""

from __future__ import annotations

import hashlib
import json
import pickle
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from tests.collectors.test_replay import make_episode, same
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.drives import gait_for
from vlnpe.collectors.locomotion.policy import PolicyMismatchError, policy_files
from vlnpe.collectors.rendering.scene.robot_body import RobotBody
from vlnpe.collectors.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import ROBOTS, RobotHandles, RobotSpec, get_robot
from vlnpe.collectors.robots.folder.export import export_robot
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import Row
from vlnpe.pipeline.inputs.crews import chosen_robots
from vlnpe.pipeline.stages import replay

pytestmark = pytest.mark.chain

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "robots.md"


def written_rover(folder: Path) -> Path:
    """The rover of docs/robots.md, as its reader would write it."""
    text = DOCUMENT.read_text()
    folder.mkdir(parents=True)
    for name, kind in (("robot.toml", "toml"), ("model.xml", "xml")):
        block = re.search(rf"```{kind}\n(.*?)```", text, re.DOTALL)
        assert block
        (folder / name).write_text(block[1])
    return folder


def exported(name: str, folder: Path) -> Path:
    robot = get_robot(name)
    export_robot(robot, folder, policy_files(robot) if robot.policy_joints else None)
    return folder


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported("aliengo", tmp_path_factory.mktemp("export") / "mydog")


@pytest.fixture(params=["rover", "mydog"])
def copied(request: pytest.FixtureRequest, dog: Path, tmp_path: Path) -> Path:
    """Return a copy of a robot's folder to be damaged."""
    folder = tmp_path / request.param
    return written_rover(folder) if folder.name == "rover" else Path(shutil.copytree(dog, folder))


@pytest.mark.parametrize("controller", ["path", "speed", "flash"])
def test_the_documented_rover_reaches_the_other_room(
    two_rooms: SceneBundle, tmp_path: Path, controller: str
):
    rover = written_rover(tmp_path / "rover")
    config = ReplayConfig(robot=str(rover), controller=controller)
    rollout = replay_episode(two_rooms, make_episode(two_rooms, yaw=1.0), config)
    assert rollout.end_reason is EndReason.SUCCESS, rollout.events
    assert rollout.robot == "rover"
    assert rollout.foot_names == ("left", "right", "back")
    if controller != "flash":
        assert rollout.imu[-1, 2] == pytest.approx(9.81, abs=0.1)
        assert rollout.foot_contact.mean() > 0.9


def test_the_documented_rover_is_what_it_says(tmp_path: Path):
    robot = get_robot(str(written_rover(tmp_path / "rover")))
    assert robot.mass_kg == pytest.approx(9 + 0.5 + 0.2 + 2 * 0.8)
    assert robot.base_height_m == pytest.approx(0.1)
    assert [joint.torque_nm for joint in robot.joints] == [8, 8]
    assert robot.camera.pitch_down_deg == pytest.approx(9.8, abs=0.1)
    assert robot.fall.pitch_rad == pytest.approx(np.deg2rad(35))


@pytest.mark.parametrize("name", ["aliengo", "jetbot"])
def test_ours_as_a_folder_move_bit_for_bit_the_same(
    two_rooms: SceneBundle, tmp_path: Path, name: str
):
    folder = exported(name, tmp_path / f"my{name}")
    episode = make_episode(two_rooms, yaw=1.0)
    ours = replay_episode(two_rooms, episode, ReplayConfig(robot=name))
    theirs = replay_episode(two_rooms, episode, ReplayConfig(robot=str(folder)))
    assert theirs.robot == f"my{name}"
    facts = {**theirs.facts, "robot_mass_kg": ours.facts["robot_mass_kg"]}
    assert same(ours, replace(theirs, robot=name, facts=facts))


@pytest.mark.parametrize("name", list(ROBOTS))
def test_ours_as_a_folder_compile_to_the_last_digit(tmp_path: Path, name: str):
    robot = get_robot(name)
    files = policy_files(robot) if robot.policy_joints else None
    if files and not files[0].is_file():
        pytest.skip(f"{name} has no policy yet")
    again = export_robot(robot, tmp_path / f"my{name}", files)
    ours, theirs = robot.build_model(), again.build_model()
    fields = [f"{kind}_{key}" for kind in ("body", "geom", "cam") for key in ("pos", "quat")]
    fields += ["body_mass", "body_inertia", "body_ipos", "geom_size", "geom_rgba", "geom_friction"]
    fields += ["jnt_range", "jnt_axis", "dof_armature", "dof_frictionloss", "actuator_gainprm"]
    for field in fields:
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field), field)
    assert again.joints == robot.joints
    assert again.feet == robot.feet
    assert again.fall == robot.fall
    assert again.command_limits == robot.command_limits
    assert again.drive == robot.drive
    assert again.physics_hash() == robot.physics_hash()


def test_every_robot_travels_to_a_worker(dog: Path):
    for robot in (*ROBOTS.values(), get_robot("jetbot@2"), get_robot(str(dog))):
        again: RobotSpec = pickle.loads(pickle.dumps(robot))
        assert again.name == robot.name
        assert again.link_mass_kg == robot.link_mass_kg
        assert again.physics_hash() == robot.physics_hash()


def test_an_edited_robot_does_its_work_again_and_a_moved_one_does_not(
    two_rooms: SceneBundle, tmp_path: Path
):
    def keys(folder: Path) -> list[str]:
        items = replay.items(
            [make_episode(two_rooms)],
            {"two_rooms": Row("repair", "two_rooms", "key", "done")},
            tmp_path,
            tmp_path,
            tmp_path,
            ReplayConfig(robot=str(folder)),
        )
        return [item.key for item in items]

    rover = written_rover(tmp_path / "rover")
    first = keys(rover)
    moved = Path(shutil.copytree(rover, tmp_path / "elsewhere" / "renamed"))
    (moved / ".hidden").write_text("an editor's own")
    assert keys(moved) == first
    (moved / "notes.txt").write_text("a part of it")
    assert keys(moved) != first
    model = rover / "model.xml"
    model.write_text(model.read_text().replace('mass="9"', 'mass="9.5"'))
    assert keys(rover) != first


def test_a_run_keeps_its_robot_and_renders_it_anywhere(tmp_path: Path):
    scenes = tmp_path / "scenes"
    bundle = write_two_rooms(scenes / "two_rooms")
    write_episodes(tmp_path / "episodes.json.gz", [make_episode(bundle)])
    rover = written_rover(tmp_path / "rover")
    out, common = tmp_path / "rollouts", ["--scenes", str(scenes), "--workers", "1"]
    arguments = ["replay", str(tmp_path / "episodes.json.gz"), "--out", str(out), *common]
    assert main([*arguments, "--robot", str(rover)]) == 0
    assert read_rollout(out / "rover" / "path" / "e0.mcap").end_reason is EndReason.SUCCESS
    # The user's folder is gone, and the run has been moved.
    shutil.rmtree(rover)
    moved = out.rename(tmp_path / "moved")
    frames = tmp_path / "frames"
    small = ["--camera", "chase", "--width-px", "96", "--height-px", "72"]
    assert main(["render", str(moved), "--out", str(frames), *small, *common]) == 0
    (video,) = frames.glob("rover/path/*/e0")
    assert read_frame_folder(video).facts["robot"] == "rover"


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    """Replace text in a file of the folder, which must have it."""

    def spoil(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return spoil


def drop(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


TOML, XML = "robot.toml", "model.xml"
MISTAKES = {
    "no facts": (drop(TOML), r"robot.toml: missing"),
    "a wheel that turns backwards": (
        edit(XML, '"right_wheel" axis="0 1 0"', '"right_wheel" axis="0 -1 0"'),
        r"model.xml: wheel 'right_wheel' turns about \(0, -1, 0\) .*valid: \(0, 1, 0\)",
    ),
    "no TOML": (edit(TOML, "[camera]", "[camera"), r"robot.toml: not valid TOML: .* line \d+"),
    "unknown field": (
        edit(TOML, "roll_deg", "rol_deg"),
        r"fall.rol_deg is unknown \(did you mean roll_deg\?\); valid: com_to_foot_m, roll_deg",
    ),
    "unknown table": (edit(TOML, "[fall]", "[wings]\n[fall]"), r"wings is unknown.*valid: name"),
    "missing field": (
        edit(TOML, "footprint_radius_m = 0.28", ""),
        r"footprint_radius_m is missing; valid: a number above 0",
    ),
    "wrong type": (edit(TOML, "0.34", '"wide"'), r"drive.track_m is 'wide'; valid: a number above"),
    "infinite": (edit(TOML, "0.34", "inf"), r"drive.track_m is inf; valid: a number above 0"),
    "limits upside down": (
        edit(TOML, "[-0.3, 0.8]", "[0.8, -0.3]"),
        r"command_limits.vx_m_s is \[0.8, -0.3\]; valid: \[low, high\] with low ≤ 0 ≤ high",
    ),
    "cannot go forward": (edit(TOML, "[-0.3, 0.8]", "[-0.3, 0]"), r"vx_m_s must reach above 0"),
    "taken name": (edit(TOML, '"rover"', '"jetbot"'), r"name is 'jetbot', which is reserved"),
    "reserved name": (edit(TOML, '"rover"', '"all"'), r"name is 'all', which is reserved"),
    "impossible name": (edit(TOML, '"rover"', '"a/b"'), r"name is 'a/b'; valid: letters, digits"),
    "joint twice": (
        edit(TOML, '"right_wheel" }]', '"left_wheel" }]'),
        r"contains the name 'left_wheel' twice",
    ),
    "missing joint": (
        edit(TOML, '[{ name = "left_wheel" }', '[{ name = "left_weel" }'),
        r"joints.left_weel is not in model.xml; valid: left_wheel, right_wheel, root",
    ),
    "unlisted joint": (
        edit(TOML, ', { name = "right_wheel" }]', "]"),
        r"drive contains 'right_wheel'; valid: left_wheel",
    ),
    "foot of another number": (
        edit(TOML, '["caster"]', '["caster", "post"]'),
        r"feet valid: one or more, each with the same number",
    ),
    "missing sole": (edit(TOML, '["caster"]', '["cster"]'), r"no geom 'cster'.*feet.back.soles"),
    "sole of a wrong shape": (
        edit(TOML, '["caster"]', '["body"]'),
        r"feet.back.soles contains 'body', a box; valid: spheres",
    ),
    "sole that nothing touches": (
        edit(XML, 'condim="1"', 'contype="0" conaffinity="0"'),
        r"feet.back.soles contains 'caster', which does not collide",
    ),
    "missing camera": (edit(TOML, '"front"', '"rear"'), r"camera.name is 'rear'; valid: front"),
    "impossible camera": (
        edit(TOML, '"front"', '"front"\nhfov_deg = 200'),
        r"camera.hfov_deg is 200; valid: above 0, below 180",
    ),
    "nothing moves it": (edit(TOML, "[drive]", "[fins]"), r"fins is unknown"),
    "no model": (drop(XML), r"model.xml: missing"),
    "no MJCF": (edit(XML, "</mujoco>", ""), r"model.xml: not valid XML: .*line \d+"),
    "bad MJCF": (edit(XML, 'mass="9"', 'mass="-9"'), r"model.xml: MuJoCo rejects it: .*mass"),
    "a floor in it": (
        edit(XML, "<worldbody>", '<worldbody><geom name="floor" type="plane" size="1 1 1"/>'),
        r"the worldbody has a geom \(floor\); valid: the robot alone",
    ),
    "fixed": (edit(XML, "<freejoint/>", ""), r"body 'base' must be free"),
    "two robots": (
        edit(
            XML, "</worldbody>", '<body name="b"><freejoint/><geom size=".1"/></body></worldbody>'
        ),
        r"the worldbody has 2 bodies; valid: one",
    ),
    "wheel with a position servo": (
        edit(XML, '<velocity joint="left_wheel" kv="3"', '<position joint="left_wheel" kp="3"'),
        r"actuator of joint 'left_wheel' must be a <velocity kv=…> of gear 1, for a wheel",
    ),
    "no servo": (
        edit(XML, '<velocity joint="left_wheel" kv="3" forcerange="-8 8"/>', ""),
        r"joint 'left_wheel' has no actuator; valid: one",
    ),
    "two servos": (
        edit(XML, '<velocity joint="left_wheel"', '<velocity joint="right_wheel"'),
        r"joint 'right_wheel' has more than one actuator; valid: one",
    ),
    "no torque limit": (
        edit(XML, 'joint="left_wheel" kv="3" forcerange="-8 8"', 'joint="left_wheel" kv="3"'),
        r"actuator of joint 'left_wheel' has no forcerange",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_each_mistake_is_reported_in_one_line(tmp_path: Path, mistake: str):
    spoil, message = MISTAKES[mistake]
    folder = written_rover(tmp_path / "rover")
    spoil(folder)
    with pytest.raises(FileFormatError, match=message) as raised:
        get_robot(str(folder))
    assert "\n" not in str(raised.value)
    assert str(folder) in str(raised.value)


def changed_card(**values: object) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        card = json.loads((folder / "policy.json").read_text())
        (folder / "policy.json").write_text(json.dumps({**card, **values}))

    return spoil


def changed_gait(**values: object) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        card = json.loads((folder / "policy.json").read_text())
        changed_card(gait={**card["gait"], **values})(folder)

    return spoil


def network_of(name: str) -> Callable[[Path], None]:
    """Another robot's network, with the card's digest of it: only its sizes are wrong."""

    def spoil(folder: Path) -> None:
        content = policy_files(get_robot(name))[0].read_bytes()
        (folder / "policy.onnx").write_bytes(content)
        changed_card(onnx_sha256=hashlib.sha256(content).hexdigest())(folder)

    return spoil


WALKING_MISTAKES = {
    "no network": (
        drop("policy.onnx"),
        r"nothing drives this robot's joints; valid: policy.onnx and policy",
    ),
    "no card": (
        drop("policy.json"),
        r"nothing drives this robot's joints; valid: policy.onnx and policy",
    ),
    "another network": (
        lambda folder: (folder / "policy.onnx").write_bytes(b"noise"),
        r"policy.onnx: is not the network that .*policy.json describes",
    ),
    "no JSON": (lambda folder: (folder / "policy.json").write_text("{"), r"policy.json: not JSON"),
    "another layout": (changed_card(observation=[["gravity_base", 3]]), r"observation layout"),
    "other joints": (changed_card(joints=["knee"]), r"trained with joints \('knee',\)"),
    "another robot": (changed_card(robot="cat"), r"robot 'cat', this robot has 'mydog'"),
    "a heavier model": (edit(XML, 'mass="13.04"', 'mass="14"'), r"model hash"),
    "a longer stride": (
        edit(TOML, "action_scale_rad = 0.5", "action_scale_rad = 0.6"),
        r"action scale",
    ),
    "another default pose": (
        edit(TOML, '"FL_calf_joint", default_rad = -1.5', '"FL_calf_joint", default_rad = -1.4'),
        r"default pose",
    ),
    "another rate": (changed_card(rate_hz=25.0), r"rate 25.0, this robot has 50.0"),
    "rows too short": (changed_gait(swing_rad=[[0.0] * 3] * 4), r"swing_rad is 4×3; valid: 4×12"),
    "ragged rows": (changed_gait(left_rad=[[0.0] * 12, [0.0]] * 2), r"left_rad is 4×-1; valid: 4×"),
    "a foot too few": (changed_gait(foot_xy_m=[[0.0, 0.0]] * 3), r"foot_xy_m is 3×2; valid: 4×2"),
    "limits of no aim": (changed_gait(aim=[], aim_limits=[[-1, 1]] * 3), r"aim_limits is 3×2"),
    "a network for fewer joints": (
        network_of("h1"),
        r"policy.onnx: its input is observation .*; valid: observation tensor\(float\) .*50",
    ),
    "no action scale": (edit(TOML, "action_scale_rad", "#"), r"action_scale_rad is missing"),
    "too many joints": (edit(TOML, "policy_joints = 12", "policy_joints = 13"), r"1 … 12"),
    "wheels too": (
        edit(
            TOML,
            "[camera]",
            '[drive]\nleft = ["FL_hip_joint"]\nright = ["FR_hip_joint"]\n'
            "wheel_radius_m = 0.1\ntrack_m = 1\n[camera]",
        ),
        r"has \[drive\], but the folder also has policy.onnx|must be a <velocity",
    ),
    "a default out of range": (
        edit(TOML, '"FL_calf_joint", default_rad = -1.5', '"FL_calf_joint", default_rad = 1.5'),
        r"joints.FL_calf_joint.default_rad is 1.5; valid: -2.775 … -0.646",
    ),
}


@pytest.mark.parametrize("mistake", WALKING_MISTAKES)
def test_each_mistake_with_a_gait_is_reported_at_once(dog: Path, tmp_path: Path, mistake: str):
    spoil, message = WALKING_MISTAKES[mistake]
    folder = Path(shutil.copytree(dog, tmp_path / "mydog"))
    spoil(folder)
    # Before anything is written: the same call that every verb begins with.
    with pytest.raises(FileFormatError, match=message):
        chosen_robots(str(folder))


def test_a_mistake_ends_a_command_with_code_two(tmp_path: Path, capsys: pytest.CaptureFixture):
    folder = written_rover(tmp_path / "rover")
    edit(TOML, '"front"', '"rear"')(folder)
    assert main(["collect", "--robot", str(folder), "--out", str(tmp_path / "run")]) == 2
    assert "camera.name is 'rear'; valid: front" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_two_robots_of_one_name_do_not_mix(tmp_path: Path):
    one, two = (written_rover(tmp_path / name) for name in ("a", "b"))
    with pytest.raises(InputError, match="two robots are named rover; rename one"):
        chosen_robots(f"{one},{two}")
    assert len(chosen_robots(f"{one},{one}")) == 1


def test_sensors_are_added_where_they_are_missing_and_kept_where_not(copied: Path):
    model = get_robot(str(copied)).build_model()
    names = [model.sensor(i).name for i in range(model.nsensor)]
    assert len(set(names)) == len(names)
    touch = {f"{foot}_touch" for foot in get_robot(str(copied)).foot_names}
    assert {"gyro", "accelerometer", *touch} == set(names)


@pytest.mark.parametrize(
    "placed",
    [
        '<geom name="caster" size=".04" pos="-.2 0 -.06"',
        '<frame pos="-.2 0 -.06"><geom name="caster" size=".04"',
        '<geom name="caster" type="cylinder" size=".04" fromto="-.2 -.01 -.06 -.2 .01 -.06"',
    ],
)
def test_a_foot_feels_the_floor_however_its_sole_is_placed(tmp_path: Path, placed: str):
    folder = written_rover(tmp_path / "rover")
    end = ' mass=".2" condim="1" priority="1"/>'
    closed = end + "</frame>" if placed.startswith("<frame") else end
    edit(XML, f'<geom name="caster" size=".04" pos="-.2 0 -.06"{end}', placed + closed)(folder)
    robot = get_robot(str(folder))
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_step(model, data, nstep=200)
    felt = data.sensordata[handles.foot_touch]
    assert felt.sum() == pytest.approx(9.81 * robot.mass_kg, rel=0.05)
    assert felt[robot.foot_names.index("back")] > 5.0


def test_meshes_and_materials_come_along(two_rooms: SceneBundle, tmp_path: Path):
    folder = written_rover(tmp_path / "rover")
    (folder / "assets").mkdir()
    trimesh.creation.icosphere(2, radius=0.1).export(folder / "assets" / "hull.stl")
    edit(
        XML,
        "<worldbody>",
        """<compiler meshdir="assets"/>
        <asset><mesh name="hull" file="hull.stl"/><material name="red" rgba="1 0 0 1"/></asset>
        <default><default class="seen">
          <geom type="mesh" group="2" contype="0" conaffinity="0" mass="0" material="red"/>
        </default></default><worldbody>""",
    )(folder)
    edit(XML, "<camera", '<geom class="seen" mesh="hull" pos="-.06 0 .15"/><camera')(folder)
    robot = get_robot(str(folder))
    surfaces = RobotBody(robot.build_model(), robot.joint_names).surfaces
    (hull,) = (s for s in surfaces if len(s.corners) == 320)
    np.testing.assert_array_equal(hull.color_linear, [1, 0, 0])
    # In a scene as well, and from another working folder.
    rollout = replay_episode(two_rooms, make_episode(two_rooms), ReplayConfig(robot=str(folder)))
    assert rollout.end_reason is EndReason.SUCCESS


def test_a_mismatch_is_its_own_error(dog: Path, tmp_path: Path):
    folder = Path(shutil.copytree(dog, tmp_path / "mydog"))
    edit(XML, 'mass="13.04"', 'mass="14"')(folder)
    with pytest.raises(PolicyMismatchError):
        gait_for(get_robot(str(folder)))
