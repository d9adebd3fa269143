"""`vlnpe robots --import`: a URDF becomes a robot folder, and what it lacks is listed."""

import json
import re
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from vlnpe.collectors.robots import get_robot
from vlnpe.pipeline.cli import main

INERTIA = '<inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>'


def link(name: str, mass: float, geometry: str, more: str = "") -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/>{INERTIA}</inertial>'
        f"<collision><geometry>{geometry}</geometry></collision>{more}</link>"
    )


def joint(name: str, kind: str, parent: str, child: str, xyz: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{more}</joint>'
    )


def wheel(side: str, y: float, axis: str, limit: str) -> str:
    tyre = '<cylinder radius="0.05" length="0.02"/>'
    turned = '<collision><origin rpy="1.5707963 0 0"/>'
    text = link(f"{side}_wheel", 0.3, tyre).replace("<collision>", turned)
    more = f'<axis xyz="{axis}"/>{limit}'
    return text + joint(
        f"{side}_joint", "continuous", "base_link", f"{side}_wheel", f"0 {y} 0", more
    )


def turtle(limit: str = "", caster: str = '<sphere radius="0.02"/>') -> str:
    mesh = '<visual><geometry><mesh filename="package://turtle/meshes/{}"/></geometry></visual>'
    return (
        '<robot name="turtle"><mujoco><compiler meshdir="/etc"/></mujoco>'
        '<link name="base_footprint"/>'
        + joint("base", "fixed", "base_footprint", "base_link", "0 0 .05")
        + link(
            "base_link", 4, '<box size=".2 .2 .06"/>', mesh.format("a.stl") + mesh.format("b.dae")
        )
        + wheel("left", 0.12, "0 1 0", limit)
        + wheel("right", -0.12, "0 -1 0", limit)
        + link("caster", 0.1, caster)
        + joint("caster_fixed", "fixed", "base_link", "caster", "-.08 0 -.03")
        + '<link name="camera_link"/>'
        + joint("camera_fixed", "fixed", "base_link", "camera_link", ".08 0 .2")
        + "</robot>"
    )


def quadruped() -> str:
    text = '<robot name="quad">' + link("trunk", 10, '<box size=".4 .2 .1"/>')
    for name, x, y in (("FL", 0.2, 0.1), ("FR", 0.2, -0.1), ("RL", -0.2, 0.1), ("RR", -0.2, -0.1)):
        above = "trunk"
        for part, axis, low, high in (
            ("hip", "1 0 0", -1, 1),
            ("thigh", "0 1 0", -1, 3),
            ("calf", "0 1 0", -2.7, -0.9),
        ):
            limit = f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="24"/>'
            place = f"{x} {y} 0" if part == "hip" else "0 0 -.2"
            text += link(f"{name}_{part}", 0.5, '<sphere radius=".03"/>')
            text += joint(f"{name}_{part}_joint", "revolute", above, f"{name}_{part}", place, limit)
            above = f"{name}_{part}"
        text += link(f"{name}_foot", 0.05, '<sphere radius=".02"/>')
        text += joint(f"{name}_fixed", "fixed", above, f"{name}_foot", "0 0 -.2")
    return text + "</robot>"


def imported(tmp_path: Path, text: str, capsys: pytest.CaptureFixture) -> tuple[Path, dict]:
    source = tmp_path / "source"
    (source / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(source / "meshes" / "a.stl")
    (source / "robot.urdf").write_text(text)
    out = tmp_path / "mine"
    code = main(["robots", "--import", str(source / "robot.urdf"), "--out", str(out), "--json"])
    assert code == 0
    return out, json.loads(capsys.readouterr().out.splitlines()[-1])


def fill(out: Path, kv: float) -> None:
    """Enter the actuators' values and remove the comment signs, as the page says."""
    model = out / "model.xml"
    text = re.sub(r"<!-- (<(?:velocity|position).*?/>) -->", r"\1", model.read_text())
    text = text.replace('kv="TODO"', f'kv="{kv}"').replace('forcerange="TODO"', 'forcerange="-2 2"')
    model.write_text(text)


def test_a_wheeled_robot_is_accepted_once_the_listed_values_are_there(tmp_path, capsys):
    out, value = imported(tmp_path, turtle(), capsys)
    assert value["todo"] == [
        "robot.toml: command_limits.vx_m_s",
        "robot.toml: command_limits.yaw_rad_s",
        "model.xml: actuator of left_joint",
        "model.xml: actuator of right_joint",
    ]
    assert any("b.dae" in note for note in value["notes"])
    assert (out / "meshes_a.stl").is_file() and not (out / "import.urdf").exists()
    facts = out / "robot.toml"
    assert main(["robots", str(out)]) == 2
    assert "vx_m_s is 'TODO'" in capsys.readouterr().err
    text = facts.read_text().replace('vx_m_s = "TODO"', "vx_m_s = [-0.2, 0.4]")
    facts.write_text(text.replace('yaw_rad_s = "TODO"', "yaw_rad_s = [-1.5, 1.5]"))
    assert main(["robots", str(out)]) == 2
    assert "no actuator" in capsys.readouterr().err
    fill(out, 0.5)
    assert main(["robots", str(out)]) == 0, capsys.readouterr()
    robot = get_robot(str(out))
    assert robot.mass_kg == pytest.approx(4.7)
    assert robot.drive is not None
    assert (robot.drive.left, robot.drive.right) == (("left_joint",), ("right_joint",))
    assert robot.drive.wheel_radius_m == pytest.approx(0.05, abs=1e-4)
    assert robot.drive.track_m == pytest.approx(0.24)
    assert {foot.name for foot in robot.feet} == {"left_wheel", "right_wheel", "caster"}
    # It drives forward: both wheels turn about +y, whatever the URDF's axes are.
    model = robot.build_model()
    data = mujoco.MjData(model)
    data.qpos[2] = robot.spawn_height_m
    data.ctrl[:] = 4.0  # [rad/s]
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    assert data.qpos[0] == pytest.approx(2.0 * 4.0 * 0.05, rel=0.2)
    assert abs(data.qpos[1]) < 0.02
    assert np.asarray(data.body("base_link").xmat)[8] > 0.99


def test_speed_limits_and_efforts_of_the_urdf_are_used(tmp_path, capsys):
    out, value = imported(tmp_path, turtle('<limit effort="3" velocity="6"/>'), capsys)
    assert value["todo"] == [f"model.xml: actuator of {s}_joint" for s in ("left", "right")]
    fill(out, 0.5)
    robot = get_robot(str(out))
    assert robot.command_limits.vx_m_s == pytest.approx((-0.3, 0.3))
    assert [joint.torque_nm for joint in robot.joints] == [3.0, 3.0]


def test_a_sole_of_another_shape_is_left_to_the_user(tmp_path, capsys):
    _, value = imported(tmp_path, turtle(caster='<box size=".04 .04 .04"/>'), capsys)
    assert "robot.toml: feet.caster.soles" in value["todo"]
    assert any("caster_0" in note for note in value["notes"])


def test_a_quadruped_has_four_feet_and_lacks_its_gait(tmp_path, capsys):
    out, value = imported(tmp_path, quadruped(), capsys)
    facts = tomllib.loads((out / "robot.toml").read_text())
    assert [foot["name"] for foot in facts["feet"]] == ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    assert len(facts["joints"]) == 12 and "drive" not in facts
    todo = value["todo"]
    assert todo[-1] == "policy.onnx and policy.json"
    assert sum(entry.startswith("model.xml: actuator of ") for entry in todo) == 12
    assert {e.removeprefix("robot.toml: ") for e in todo if e.startswith("robot.toml")} == {
        *(f"joints.{joint['name']}.default_rad" for joint in facts["joints"]),
        "action_scale_rad",
        "camera.name",
        "fall.com_to_foot_m",
        *(f"command_limits.{key}" for key in ("vx_m_s", "vy_m_s", "yaw_rad_s")),
    }
    model = (out / "model.xml").read_text()
    assert 'range="-2.7 -0.9"' in model and 'forcerange="-24 24"' in model


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        (
            '<box size=".2 .2 .06"/>',
            '<mesh filename="../secret/a.stl"/>',
            "leads out of the robot's",
        ),
        ('<box size=".2 .2 .06"/>', '<mesh filename="/etc/a.stl"/>', "leads out of the robot's"),
        (
            '<box size=".2 .2 .06"/>',
            '<mesh filename="a.dae"/>',
            "collision mesh 'a.dae' is missing or no .stl",
        ),
        ('value="4"', 'value="nan"', "not finite"),
        ('value="4"', 'value="-4"', "valid: 0 or above"),
        ('<child link="caster"/>', '<child link="camera_link"/>', "valid: 1"),
        ("<robot ", "<!DOCTYPE a><robot ", "document type"),
        ("robot>", "sdf>", "not valid XML"),
        ('<mass value="0.3"/>', '<mass value="0"/>', "MuJoCo rejects it"),
    ],
)
def test_a_bad_urdf_is_refused_in_one_line(tmp_path, capsys, old: str, new: str, reason: str):
    (tmp_path / "bad.urdf").write_text(turtle().replace(old, new))
    out = tmp_path / "mine"
    assert main(["robots", "--import", str(tmp_path / "bad.urdf"), "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert reason in printed.out + printed.err
    assert not out.exists()
