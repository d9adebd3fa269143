"""Mistakes in a robot's folder are reported in one line."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.robot_folders import TOML, XML, edit, exported, written_rover
from vlnpe.collectors.locomotion.runtime.drives import gait_for
from vlnpe.collectors.locomotion.runtime.policy import PolicyMismatchError, policy_files
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.pipeline.cli import main
from vlnpe.pipeline.inputs.crews import chosen_robots

pytestmark = pytest.mark.chain


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported("aliengo", tmp_path_factory.mktemp("export") / "mydog")


def drop(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


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
    "limits beyond every float": (
        edit(TOML, "[-0.3, 0.8]", f"[-0.3, 1{'0' * 400}]"),
        r"command_limits.vx_m_s is .*; valid: \[low, high\]",
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
        (folder / "policy.safetensors").write_bytes(content)
        changed_card(network_sha256=hashlib.sha256(content).hexdigest())(folder)

    return spoil


WALKING_MISTAKES = {
    "no network": (
        drop("policy.safetensors"),
        r"to drive this robot's joints; valid: policy.safetensors or policy.onnx, and policy",
    ),
    "no card": (
        drop("policy.json"),
        r"to drive this robot's joints; valid: policy.safetensors or policy.onnx, and policy",
    ),
    "another network": (
        lambda folder: (folder / "policy.safetensors").write_bytes(b"noise"),
        r"policy.safetensors: is not the network that .*policy.json describes",
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
        r"policy.safetensors: it takes 194 numbers and gives 10; valid: an observation of 230",
    ),
    "no action scale": (edit(TOML, "action_scale_rad = 0.5", "action_scale_rad = 0.4"), r"scale"),
    "too many joints": (edit(TOML, "policy_joints = 12", "policy_joints = 13"), r"1 … 12"),
    "wheels too": (
        edit(
            TOML,
            "[camera]",
            '[drive]\nleft = ["FL_hip_joint"]\nright = ["FR_hip_joint"]\n'
            "wheel_radius_m = 0.1\ntrack_m = 1\n[camera]",
        ),
        r"has \[drive\], but the folder also has policy.safetensors|must be a <velocity",
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


def test_a_mismatch_is_its_own_error(dog: Path, tmp_path: Path):
    folder = Path(shutil.copytree(dog, tmp_path / "mydog"))
    edit(XML, 'mass="13.04"', 'mass="14"')(folder)
    with pytest.raises(PolicyMismatchError):
        gait_for(get_robot(str(folder)))
