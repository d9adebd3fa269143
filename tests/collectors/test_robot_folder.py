"""A user's own robot: it drives, travels to workers and stays in its run."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from tests.collectors.test_replay import make_episode, same
from tests.support.robot_folders import TOML, XML, edit, exported, written_rover
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.locomotion.runtime.policy import policy_files
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import ROBOTS, RobotHandles, RobotSpec, get_robot
from vlnpe.collectors.robots.folder.export import export_robot
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.engine.ledger import Row
from vlnpe.pipeline.stages.rollouts import replay_items
from vlnpe.pipeline.stages.rollouts.replay_job import Walker
from vlnpe.rendering.scene.robot_body import RobotBody

pytestmark = pytest.mark.chain


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


@pytest.mark.parametrize("name", [*ROBOTS, "go2"])
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
    assert again.rhythm == robot.rhythm
    assert again.physics_hash() == robot.physics_hash()


@pytest.mark.parametrize("line", ['"name" = "rover"', 'name = """\\\nrover"""'])
def test_a_name_that_is_not_found_is_not_changed_by_halves(tmp_path: Path, line: str):
    rover = written_rover(tmp_path / "rover")
    edit(TOML, 'name = "rover"', line)(rover)
    with pytest.raises(FileFormatError, match=r"robot\.toml: its name is not found"):
        export_robot(get_robot(str(rover)), tmp_path / "other", None)
    assert not (tmp_path / "other").exists()


def test_every_robot_travels_to_a_worker(dog: Path):
    for robot in (*ROBOTS.values(), get_robot("jetbot@2"), get_robot(str(dog))):
        again: RobotSpec = pickle.loads(pickle.dumps(robot))
        assert again.name == robot.name
        assert again.physics_hash() == robot.physics_hash()


def test_an_edited_robot_does_its_work_again_and_a_moved_one_does_not(
    two_rooms: SceneBundle, tmp_path: Path
):
    def keys(folder: Path) -> list[str]:
        items = replay_items.items(
            [make_episode(two_rooms)],
            {"two_rooms": Row("repair", "two_rooms", "key", "done")},
            tmp_path,
            tmp_path,
            tmp_path,
            Walker(get_robot(str(folder)), ReplayConfig(robot="rover")),
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


@pytest.mark.usefixtures("inline")
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
