"""The estimator of a robot's state, on the product's models: kinematics, errors, bit-equality."""

from copy import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.collectors.locomotion.test_gait_step import shaken
from tests.collectors.test_replay import make_episode
from vlnpe.collectors.locomotion.runtime.estimator import StateEstimator
from vlnpe.collectors.locomotion.runtime.legs import Legs, foot_motion
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.runtime.sensors import SensorErrors, Sensors, Simulation
from vlnpe.collectors.locomotion.trials.trial import STEP_S, Conditions, Trial
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import RobotHandles, get_robot
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.scene.bundle import SceneBundle

pytestmark = pytest.mark.chain

ROBOTS = ["aliengo", "h1", "g1"]


@pytest.mark.parametrize("name", ROBOTS)
def test_feet_are_and_move_where_mujoco_says(name: str):
    robot, rng = get_robot(name), np.random.default_rng(0)
    for _ in range(5):
        data = shaken(robot, rng)
        model, handles = data.model, RobotHandles.find(robot, data.model)
        data.qpos[:7], data.qvel[:6] = (0, 0, 1, 1, 0, 0, 0), 0.0
        mujoco.mj_forward(model, data)
        legs, down = Legs.of(model, handles), rng.normal(size=3)
        down /= np.linalg.norm(down)
        base = data.xpos[handles.root_body]
        for foot, soles in enumerate(handles.sole_geoms):
            skin = data.geom_xpos[soles] + legs.radius[foot][:, None] * down
            lowest = skin[np.argmax(skin @ down)]
            jacobian = np.zeros((3, model.nv))
            body = int(model.geom_bodyid[soles[0]])
            point, velocity = np.zeros(3), np.zeros(3)
            arrays = data.qpos[handles.joint_qpos], data.qvel[handles.joint_dof]
            foot_motion(legs, foot, *arrays, np.zeros(len(robot.joints)), down, point, velocity)
            assert np.linalg.norm(point - (lowest - base)) < 0.02
            mujoco.mj_jac(model, data, jacobian, None, point + base, body)
            np.testing.assert_allclose(velocity, jacobian @ data.qvel, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_motors_of_a_standing_robot_carry_its_weight(name: str):
    """Held in its default pose by its base, each foot in the air or under its share of weight."""
    robot = get_robot(name)
    model = robot.build_model(floor=False)
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_forward(model, data)
    legs, share = Legs.of(model, handles), 1.0 / len(robot.feet)
    for foot, soles in enumerate(handles.sole_geoms):
        body = int(model.geom_bodyid[soles[0]])
        point, velocity, down = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, -1.0])
        joints = data.qpos[handles.joint_qpos], data.qvel[handles.joint_dof]
        for loaded in (0.0, share):
            foot_motion(legs, foot, *joints, np.zeros(len(robot.joints)), down, point, velocity)
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point + data.xpos[handles.root_body], body)
            holding = data.qfrc_bias - jacobian.T @ (0.0, 0.0, loaded * legs.weight[0])
            torque = holding[handles.joint_dof]
            carried = foot_motion(legs, foot, *joints, torque, down, point, velocity)
            assert carried == pytest.approx(loaded, abs=0.03)


def readings_of(policy: GaitPolicy, data: mujoco.MjData, seed: int) -> Sensors:
    memory = (data.qpos, data.qvel, data.sensordata, data.actuator_force)
    simulation = Simulation(*(array[None] for array in memory))
    return Sensors(simulation, RobotHandles.find(policy.robot, data.model), SensorErrors(), seed)


def walked(policy: GaitPolicy, seconds: float, friction: float) -> np.ndarray:
    """Return the errors of estimated velocity [m/s] and attitude [rad], (steps, robots, 2)."""
    rng = np.random.default_rng(1)
    trial = Trial(policy, Conditions(friction=friction), np.zeros((3, 2)), np.zeros(3), rng)
    commands, errors = np.array([[0.6, 0.0, 0.0], [0.3, 0.1, 0.5], [0.0, 0.0, -0.8]]), []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        errors.append(trial.estimate_error)
    assert not trial.fallen.any()
    reached = trial.position_m[0, 0] / seconds
    assert reached == pytest.approx(0.6, abs=0.25)
    return np.array(errors)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("friction", [0.4, 1.0])
def test_a_robot_walks_by_its_own_sensors(name: str, friction: float):
    policy = GaitPolicy.load(get_robot(name)).estimating()
    velocity, attitude = np.sqrt(np.mean(np.square(walked(policy, 4.0, friction)), axis=(0, 1)))
    assert 0.005 < velocity < 0.2
    assert np.rad2deg(attitude) < 2.5


def test_the_estimate_does_not_know_where_the_robot_is():
    """Nor its velocity: it tells the same from the same sensors of a train that rolls north."""
    policy, model = GaitPolicy.load(get_robot("h1")), get_robot("h1").build_model()
    still, train = mujoco.MjData(model), mujoco.MjData(model)
    handles = RobotHandles.find(policy.robot, model)
    bodies = []
    for data, x_m, yaw_rad, speed_m_s in ((still, 0.0, 0.0, 0.0), (train, 9.0, 2.0, 3.0)):
        handles.spawn(data, x_m=x_m, yaw_rad=yaw_rad)
        data.qvel[handles.root_dof] += speed_m_s
        mujoco.mj_forward(model, data)
        sensors, estimator = readings_of(policy, data, 5), StateEstimator(model, handles, 1)
        bodies.append([estimator.update(sensors.read()).copy() for _ in range(10)][-1])
    np.testing.assert_allclose(bodies[1], bodies[0], atol=1e-9)
    assert np.abs(bodies[0][0, :3]).max() < 0.1


def test_errors_come_from_the_seed_alone_and_a_step_can_be_repeated():
    policy, targets = GaitPolicy.load(get_robot("g1")), {}

    def walked(data: mujoco.MjData, steps: int) -> np.ndarray:
        for _ in range(steps):
            data.ctrl[:] = policy.act(data, (0.3, 0.0, 0.0))
            mujoco.mj_step(data.model, data, 4)
        return policy.act(data, (0.3, 0.0, 0.0)).copy()

    for seed in (3, 3, 4, None):
        data = mujoco.MjData(policy.robot.build_model())
        RobotHandles.find(policy.robot, data.model).spawn(data)
        policy.reset(seed)
        walked(data, 10)
        kept, before = [array.copy() for array in policy.memory], copy(data)
        first = walked(data, 10)
        np.testing.assert_array_equal(targets.setdefault(seed, first), first)
        mujoco.mj_copyData(data, data.model, before)
        for array, value in zip(policy.memory, kept, strict=True):
            array[:] = value
        np.testing.assert_array_equal(walked(data, 10), first)
    assert len({target.tobytes() for target in targets.values()}) == 3


def test_a_replay_by_sensors_arrives_says_so_and_repeats_its_bits(two_rooms: SceneBundle):
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    episode, plain = make_episode(two_rooms, goal=(3.0, 1.5)), ReplayConfig()
    sensed = replace(plain, state="estimated")
    walks = [replay_in(world, episode, config) for config in (sensed, plain, sensed)]
    assert [walk.facts["policy_state"] for walk in walks] == ["estimated", "true", "estimated"]
    assert {walk.end_reason for walk in walks} == {EndReason.SUCCESS}
    first, true, again = (walk.joint_position_rad for walk in walks)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[:200], true[:200])


def test_legs_that_are_no_chains_of_hinges_are_refused():
    robot = get_robot("jetbot")
    model = robot.build_model()
    handles = RobotHandles.find(robot, model)
    spread = replace(handles, sole_geoms=handles.sole_geoms.reshape(1, -1))
    with pytest.raises(InputError, match="soles on 3 bodies; valid: 1"):
        Legs.of(model, spread)
    with pytest.raises(InputError, match="is on its base; valid: on a leg"):
        Legs.of(model, handles)
    walker = get_robot("h1")
    model = walker.build_model()
    handles = RobotHandles.find(walker, model)
    held = replace(handles, joint_dof=np.full(len(walker.joints), 99))
    with pytest.raises(InputError, match="valid: one hinge with a servo"):
        Legs.of(model, held)
