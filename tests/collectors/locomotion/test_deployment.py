"""The card for deployment, and the loop that runs a gait outside of vlnpe."""

import json
import math
import runpy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.locomotion.contract import write_deployment
from vlnpe.collectors.locomotion.contract.motors import MOTORS
from vlnpe.collectors.locomotion.runtime.card import load_card
from vlnpe.collectors.locomotion.runtime.observation import states_of
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.second_engine.servo import Servos
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.robots import POLICY_DECIMATION, RobotHandles, get_robot
from vlnpe.pipeline.cli import main

WALKERS = [*GAITS, "go2"]
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "gait_loop.py"


@pytest.fixture(scope="module")
def cards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cards")
    for name in WALKERS:
        write_deployment(get_robot(name), folder)
    return folder


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLE))


@pytest.mark.parametrize("name", WALKERS)
def test_the_loop_reproduces_another_walk_bit_by_bit(
    name: str, cards: Path, example: dict[str, Any]
):
    """Commands change at random, twice a second; the base is pushed; noise is on the velocity."""
    robot, rng = get_robot(name), np.random.default_rng(5)
    policy, loop = GaitPolicy.load(robot), example["GaitLoop"](cards / f"{name}.json")
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    command = np.zeros(3)
    for step in range(300):
        if step % 25 == 10:
            command = rng.uniform(-1.2, 1.2, 3) * (rng.random() > 0.2)
        if step == 5:  # while it stands
            data.qvel[handles.root_dof : handles.root_dof + 2] += 0.4, 0.3
        if step % 90 == 60:
            data.qvel[handles.root_dof : handles.root_dof + 2] += rng.normal(0, 0.3, 2)
        state, q = states_of(data.qpos[None], data.qvel[None], handles), handles.root_qpos
        sensors = (
            data.qpos[q + 3 : q + 7],
            state.angular_velocity_rad_s[0],
            state.linear_velocity_m_s[0],
            data.qpos[handles.joint_qpos],
            data.qvel[handles.joint_dof],
        )
        targets = policy.act(data, command)
        np.testing.assert_array_equal(loop.step(*sensors, command), targets, f"step {step}")
        data.ctrl[handles.actuators] = targets
        mujoco.mj_step(model, data, nstep=POLICY_DECIMATION)


@pytest.mark.parametrize("name", WALKERS)
def test_the_example_reproduces_the_recorded_walk(
    name: str, cards: Path, example: dict[str, Any], capsys: pytest.CaptureFixture[str]
):
    assert example["main"](cards / f"{name}.json", cards / f"{name}-walk.npz") == 0
    assert capsys.readouterr().out == f"{name}: 700 of 700 steps bit-identical\n"


def test_the_example_finds_a_difference(
    cards: Path, example: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    walk = dict(np.load(cards / "h1-walk.npz"))
    walk["joint_rad"][500, 3] += 1e-5
    np.savez(tmp_path / "other.npz", allow_pickle=False, **walk)
    assert example["main"](cards / "h1.json", tmp_path / "other.npz") == 1
    assert capsys.readouterr().out.startswith("h1: 500 of 700")


@pytest.mark.parametrize("name", WALKERS)
def test_a_card_has_the_motors_and_stays_a_policy_card(
    name: str, cards: Path, example: dict[str, Any]
):
    robot, path = get_robot(name), cards / f"{name}.json"
    load_card(path).check(robot, path)
    facts = json.loads(path.read_text())["deployment"]
    motors = [joint["motor"] for joint in facts["joints"]]
    assert len(set(motors)) == len(robot.joints) and None not in motors
    assert max(motors) < facts["sdk"]["slots"]
    assert [(b["name"], b["width"]) for b in facts["observation"]] == load_card(path).observation
    ordered = example["GaitLoop"](path).to_motors(range(len(motors)), unused=-1.0)
    assert [ordered[motor] for motor in motors] == list(range(len(motors)))
    assert (ordered == -1.0).sum() == facts["sdk"]["slots"] - len(motors)


@pytest.mark.parametrize("name", WALKERS)
def test_the_card_tells_where_on_the_robot_the_camera_is(name: str, cards: Path):
    camera = json.loads((cards / f"{name}.json").read_text())["deployment"]["camera"]
    robot = get_robot(name)
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_forward(model, data)
    link = data.body(camera["link"])
    assert model.body(camera["link"]).jntnum[0] > 0  # it is one of the robot's own
    place = link.xpos + link.xmat.reshape(3, 3) @ camera["position_m"]
    np.testing.assert_allclose(place, data.cam(robot.camera.name).xpos, atol=1e-5)
    forward = -data.cam(robot.camera.name).xmat.reshape(3, 3)[:, 2]  # of a level base
    assert math.degrees(math.asin(-forward[2])) == pytest.approx(camera["pitch_down_deg"], abs=0.01)


def test_motors_are_those_of_unitrees_examples():
    # Of unitree_rl_gym's deploy_real/configs, in the order of the robot descriptions.
    h1 = "left_hip_yaw left_hip_roll left_hip_pitch left_knee left_ankle "
    h1 += "right_hip_yaw right_hip_roll right_hip_pitch right_knee right_ankle"
    index = MOTORS["h1"].index
    assert [index[f"{j}_joint"] for j in h1.split()] == [7, 3, 4, 5, 10, 8, 0, 1, 2, 11]
    assert [MOTORS["g1"].index[j] for j in get_robot("g1").joint_names] == list(range(29))
    assert [MOTORS["go2"].index[f"{j}_joint"] for j in ("FR_hip", "FL_hip", "RL_calf")] == [
        0,
        3,
        11,
    ]


@pytest.mark.parametrize("name", WALKERS)
def test_torques_are_mujocos(name: str):
    robot, rng = get_robot(name), np.random.default_rng(2)
    model, servos = robot.build_model(), Servos(robot)
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    for _ in range(50):
        handles.spawn(data)
        count = len(robot.joints)
        data.qpos[handles.joint_qpos] += rng.normal(0, 0.5, count)
        data.qvel[handles.joint_dof] = rng.normal(0, 15, count)
        target = robot.default_joint_rad + rng.normal(0, 2, count)
        data.ctrl[handles.actuators] = target
        mujoco.mj_forward(model, data)
        torque = servos.torque(target, data.qpos[handles.joint_qpos], data.qvel[handles.joint_dof])
        np.testing.assert_allclose(torque, data.actuator_force[handles.actuators], atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--card", "jetbot", "--out", "x"), "does not walk"),
        (("--card", "h1"), "requires --out"),
        (("--card", "h1", "--export", "g1", "--out", "x"), "cannot be combined"),
    ],
)
def test_robots_without_a_card_are_refused(
    arguments: tuple[str, ...], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["robots", *arguments]) == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
