"""The learned gaits at work, on the product's own models and through its public calls."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from tests.collectors.test_robots import in_larger_scene
from vlnpe.collectors.locomotion.runtime import GaitPolicy, PolicyMismatchError
from vlnpe.collectors.locomotion.runtime.card import POLICY_FOLDER
from vlnpe.collectors.locomotion.runtime.gait import RATE_HZ, ClockState, catch, tick
from vlnpe.collectors.locomotion.runtime.observation import states_of
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.locomotion.trials.evaluate import (
    command_grid,
    follow_paths,
    pushes,
    standing,
    standing_pushes,
    velocity_errors,
)
from vlnpe.collectors.locomotion.trials.terrain import noise_terrain
from vlnpe.collectors.locomotion.trials.trial import Conditions
from vlnpe.collectors.robots import POLICY_DECIMATION, RobotHandles, get_robot
from vlnpe.formats.core.arrays import Array
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.process.kernel import kernel

pytestmark = pytest.mark.chain

WALKERS = ["aliengo"]


@kernel()
def _catch(tables, state, body, target):
    catch(tables, state, body, target)


@kernel()
def _tick(tables, state, target):
    tick(tables, state, target)


@pytest.fixture(scope="module", params=WALKERS)
def policy(request) -> GaitPolicy:
    return GaitPolicy.load(get_robot(request.param))


class Walk:
    """The robot in a MuJoCo model, moved by its policy through `ctrl` and nothing else."""

    def __init__(self, policy: GaitPolicy, model: mujoco.MjModel):
        self.policy, self.model, self.data = policy, model, mujoco.MjData(model)
        self.handles = RobotHandles.find(policy.robot, model)
        self.handles.spawn(self.data)
        mujoco.mj_forward(model, self.data)
        policy.reset()
        self.tilt = 0.0

    def go(self, command, seconds: float) -> None:
        for _ in range(round(seconds * RATE_HZ)):
            before = self.data.qpos.copy(), self.data.qvel.copy()
            self.data.ctrl[self.handles.actuators] = self.policy.act(self.data, command)
            # The policy reads the state and never writes it.
            assert np.array_equal(before[0], self.data.qpos)
            assert np.array_equal(before[1], self.data.qvel)
            mujoco.mj_step(self.model, self.data, POLICY_DECIMATION)
            up = self.data.xmat[self.handles.root_body][8]
            self.tilt = max(self.tilt, float(np.arccos(np.clip(up, -1, 1))))

    @property
    def position(self) -> np.ndarray:
        return self.data.qpos[self.handles.root_qpos : self.handles.root_qpos + 3].copy()

    @property
    def yaw(self) -> float:
        w, _, _, z = self.data.qpos[self.handles.root_qpos + 3 : self.handles.root_qpos + 7]
        return float(2 * np.arctan2(z, w))


@pytest.fixture(params=["alone", "attached"])
def walk(policy: GaitPolicy, request) -> Walk:
    robot = policy.robot
    alone = request.param == "alone"
    return Walk(policy, robot.build_model() if alone else in_larger_scene(robot, "robot/"))


def test_walks_three_metres_straight(walk: Walk):
    walk.go((0.0, 0.0, 0.0), 1.0)
    start, heading = walk.position, walk.yaw
    walk.go((0.75, 0.0, 0.0), 4.0)
    forward = walk.position - start
    along = forward[0] * np.cos(heading) + forward[1] * np.sin(heading)
    aside = forward[1] * np.cos(heading) - forward[0] * np.sin(heading)
    assert along == pytest.approx(3.0, abs=0.35)
    assert abs(aside) < 0.3
    assert abs(walk.yaw - heading) < np.deg2rad(12)
    assert walk.tilt < np.deg2rad(15)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_turns_in_place(policy: GaitPolicy, direction: float):
    walk = Walk(policy, policy.robot.build_model())
    walk.go((0.0, 0.0, 0.0), 1.0)
    start, heading = walk.position, walk.yaw
    walk.go((0.0, 0.0, 1.05 * direction), 2.0)
    turned = np.arctan2(np.sin(walk.yaw - heading), np.cos(walk.yaw - heading))
    assert turned == pytest.approx(2.1 * direction, abs=0.35)
    assert np.linalg.norm((walk.position - start)[:2]) < 0.2


def test_stands_still_at_its_height(policy: GaitPolicy):
    result = standing(policy)
    assert result["drift_m"] < 0.03
    assert result["joint_speed_rms_rad_s"] < 0.1
    assert result["base_height_m"] == pytest.approx(policy.robot.base_height_m, abs=0.03)
    assert result["falls"] == 0


def test_stops_after_walking(policy: GaitPolicy):
    walk = Walk(policy, policy.robot.build_model())
    walk.go((0.8, 0.0, 0.0), 2.0)
    walk.go((0.0, 0.0, 0.0), 1.0)
    start = walk.position
    walk.go((0.0, 0.0, 0.0), 2.0)
    assert np.linalg.norm((walk.position - start)[:2]) < 0.05
    assert policy.phase == 0.0


def test_tracks_velocities_with_lifted_feet_and_little_slip(policy: GaitPolicy):
    rng = np.random.default_rng(5)
    result = velocity_errors(policy, command_grid(policy.robot), Conditions(), rng, 4.0, 1.5)
    assert result["falls"] == 0
    assert result["linear_error_mean_m_s"] < 0.08
    assert result["yaw_error_mean_rad_s"] < 0.12
    assert result["foot_lift_m"] > 0.035
    assert result["foot_slip_m_s"] < 0.1


@pytest.mark.parametrize("name", list(GAITS))
def test_soles_stand_on_the_floor_and_barely_sink_at_touch_down(name: str):
    robot = get_robot(name)
    walk = Walk(GaitPolicy.load(robot), robot.build_model())
    soles, radius_m = walk.handles.sole_geoms, walk.handles.sole_radius_m
    depth_m, touching = [], []
    for command in [(0.0, 0.0, 0.0)] * 50 + [(0.8, 0.0, 0.3)] * 150:
        walk.go(command, 0.02)
        mujoco.mj_kinematics(walk.model, walk.data)
        depth_m.append((radius_m - walk.data.geom_xpos[soles, 2]).max(axis=1))
        touching.append(walk.data.sensordata[walk.handles.foot_touch] > 1.0)
    standing_m = depth_m[49]
    assert np.abs(standing_m).max() < 0.002
    sunk = np.array(depth_m)[np.array(touching)]
    assert np.quantile(sunk, 0.95) < 0.005
    assert sunk.max() < 0.013


def test_reaches_the_end_of_random_paths(policy: GaitPolicy):
    rng = np.random.default_rng(11)
    assert follow_paths(policy, 6, Conditions(), rng)["reached"] == 1.0


def test_walks_on_bumps(policy: GaitPolicy):
    rng = np.random.default_rng(12)
    commands = np.array([[0.6, 0.0, 0.0], [0.4, 0.0, 0.5], [0.0, 0.0, 0.8], [0.3, 0.2, 0.0]])
    conditions = Conditions(noise_terrain(rng, 0.03, size_m=16.0))
    result = velocity_errors(policy, commands, conditions, rng, 4.0, 1.5)
    assert result["falls"] == 0


def test_survives_most_kicks(policy: GaitPolicy):
    assert pushes(policy, 10, 0.5, np.random.default_rng(3))["survived"] >= 0.7


def test_same_start_gives_the_same_walk(policy: GaitPolicy):
    ends = []
    for _ in range(2):
        walk = Walk(policy, policy.robot.build_model())
        walk.go((0.5, 0.1, 0.3), 1.0)
        ends.append(walk.data.qpos.copy())
    np.testing.assert_array_equal(ends[0], ends[1])


def copied(policy: GaitPolicy, folder: Path) -> Path:
    for suffix in ("json", "safetensors"):
        shutil.copy(POLICY_FOLDER / f"{policy.robot.name}.{suffix}", folder)
    return folder / f"{policy.robot.name}.json"


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("physics_hash", "0" * 64, "model hash"),
        ("observation", [["gravity_base", 3]], "observation layout"),
        ("joints", ["a", "b"], "joints"),
        ("action_scale_rad", 0.3, "action scale"),
        ("robot", "spot", "robot"),
        ("network_sha256", "0" * 64, "network"),
    ],
)
def test_refuses_a_policy_of_something_else(policy, tmp_path, key, value, message):
    path = copied(policy, tmp_path)
    card = json.loads(path.read_text())
    card[key] = value
    path.write_text(json.dumps(card))
    with pytest.raises(PolicyMismatchError, match=message):
        GaitPolicy.load(policy.robot, tmp_path)


def test_refuses_a_changed_robot(policy: GaitPolicy):
    def heavier(robot):
        spec = policy.robot.build(robot)
        spec.body(robot.root_body).mass += 1.0
        return spec

    with pytest.raises(PolicyMismatchError, match="model hash"):
        GaitPolicy.load(replace(policy.robot, build=heavier))


@pytest.mark.parametrize("content", ["", "{}", "[1, 2]"])
def test_a_broken_card_is_named(policy: GaitPolicy, tmp_path: Path, content: str):
    copied(policy, tmp_path).write_text(content)
    with pytest.raises(FileFormatError, match=r"not a policy card|not JSON|not a JSON object"):
        GaitPolicy.load(policy.robot, tmp_path)


def test_a_missing_policy_is_named(policy: GaitPolicy, tmp_path: Path):
    with pytest.raises(FileFormatError, match="train"):
        GaitPolicy.load(policy.robot, tmp_path)


def test_policy_file_is_small(policy: GaitPolicy):
    assert (POLICY_FOLDER / f"{policy.robot.name}.safetensors").stat().st_size < 2_000_000


def test_observation_matches_mujocos_own_frames(policy: GaitPolicy):
    robot = policy.robot
    model = robot.build_model()
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)
    rng = np.random.default_rng(2)
    data.qpos[:] = rng.normal(size=model.nq)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qvel[:] = rng.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    world_from_base = data.xmat[handles.root_body].reshape(3, 3)
    gyro = data.sensordata[handles.gyro : handles.gyro + 3]
    state = states_of(data.qpos[None], data.qvel[None], handles)
    np.testing.assert_allclose(state.gravity[0], world_from_base.T @ (0, 0, -1), atol=1e-9)
    expected = world_from_base.T @ data.qvel[:3]
    np.testing.assert_allclose(state.linear_velocity_m_s[0], expected, atol=1e-9)
    np.testing.assert_allclose(state.angular_velocity_rad_s[0], gyro, atol=1e-9)
    np.testing.assert_array_equal(state.joint_rad[0], data.qpos[handles.joint_qpos])
    np.testing.assert_array_equal(state.joint_rad_s[0], data.qvel[handles.joint_dof])


def test_a_zero_command_is_braked_to_and_the_last_steps_are_taken_to_their_ends():
    gait = replace(GAITS["h1"], brake_m_s2=2.0, brake_rad_s2=4.0, last_steps=2)
    state, dt = ClockState.standing(1), 0.02
    walk, stop = np.array([[1.0, 0.0, 0.5]]), np.zeros((1, 3))
    for _ in range(20):
        _tick(gait.tables, state, walk)
    # What rises is followed at once.
    np.testing.assert_array_equal(state.command, walk)
    speeds, phases = [], []
    while state.moving[0]:
        _tick(gait.tables, state, stop)
        speeds.append(state.command[0, 0])
        phases.append(float(state.phase[0]))
        assert len(speeds) < 100
    np.testing.assert_allclose(-np.diff([1.0, *speeds[:25]]), 2.0 * dt, atol=1e-9)
    still = next(k for k, v in enumerate(speeds) if v <= gait.stand_linear_m_s)
    landings = np.flatnonzero(np.diff(np.floor(2.0 * np.array(phases[:-1]))) != 0) + 1
    # Two steps end after the command has come to nothing, the second one with the standing.
    assert (landings >= still).sum() == 1
    assert phases[-1] == 0.0
    assert phases[-2] > 0.5 - gait.frequency_hz * dt or phases[-2] % 0.5 > 0.4
    # From then on it waits.
    _tick(gait.tables, state, stop)
    assert not state.moving[0]


def test_a_standing_robot_walks_after_its_base_when_it_is_pushed_and_stands_again():
    gait = replace(GAITS["h1"], catch_m_s=0.25, catch_share=0.5, catch_s=0.1)
    state, still = ClockState.standing(4), np.zeros((1, 2))

    def step(velocity: ArrayLike, command: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
        target = np.tile(np.asarray(command, dtype=float), (4, 1))
        _catch(gait.tables, state, np.asarray(velocity) + np.zeros((4, 2)), target)
        _tick(gait.tables, state, target)
        return state.command.copy()

    # Gently, hard, hard in another direction, and hard without any of this.
    pushed = np.array([[0.2, 0.1], [0.4, 0.0], [0.0, -0.6], [0.2, 0.1]])
    caught = [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, -0.3, 0.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(step(pushed), caught)
    for _ in range(4):
        # It keeps to what it began, whatever the base does meanwhile.
        np.testing.assert_allclose(step(-pushed), caught)
    assert state.moving.tolist() == [False, True, True, False]
    assert (np.abs(step(still)) < np.abs(caught) + 1e-12).all()
    for _ in range(60):
        step(still)
    assert not state.moving.any() and not state.command.any()
    # A command to walk is obeyed at once, and walking catches nothing.
    step(pushed)
    np.testing.assert_allclose(step(pushed, (0.5, 0.0, 0.0))[:, 0], 0.5)
    np.testing.assert_allclose(step(pushed)[:, 0], 0.5 - 3.0 / RATE_HZ)
    assert not ClockState.standing(1).catching.any()


@pytest.mark.parametrize("name", ["h1", "g1"])
def test_a_humanoid_pushed_while_it_stands_steps_and_stays_up(name: str):
    policy = GaitPolicy.load(get_robot(name))
    stiff = policy.changed(
        policy.robot, replace(policy.card, gait=replace(policy.card.gait, catch_m_s=None))
    )
    results = [standing_pushes(each, 12, 0.8, np.random.default_rng(4)) for each in (policy, stiff)]
    caught, held = (result["upright"] for result in results)
    assert caught >= 11 / 12 > held + 0.3
    # It walks after its base, not away.
    assert results[0]["drift_m_p95"] < 1.0


def test_clock_stands_and_trots():
    gait = GAITS["aliengo"]
    command = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, -0.3]])
    moving = gait.moving(command)
    assert moving.tolist() == [False, True, True]
    state = ClockState.standing(3)
    state.phase[:] = 0.98
    _tick(gait.tables, state, command)
    assert state.moving.tolist() == moving.tolist()
    after = state.phase
    assert after[0] == 0.0
    np.testing.assert_allclose(after[1:], 0.02)
    front_left, front_right, rear_left, rear_right = (gait.foot_phase(after[1:2]) < 0.5)[0]
    assert front_left == rear_right != front_right == rear_left
