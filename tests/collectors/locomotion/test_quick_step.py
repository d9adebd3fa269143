"""The compiled step of one robot equals the vectorised reference code."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.gait import FACTORS, ClockState, GaitClock, joint_targets
from vlnpe.collectors.locomotion.runtime.observation import observe, remember, states_of
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.runtime.quick import QuickStep
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.robots import RobotHandles, RobotSpec, get_robot

CALIBRATED = replace(
    GAITS["aliengo"],
    aim=tuple(map(tuple, np.random.default_rng(0).normal(0, 0.3, (3, len(FACTORS))).tolist())),
    aim_limits=((-0.5, 1.2), (-0.4, 0.5), (-1.3, 1.2)),
)
CASES = [
    *((get_robot(name), gait) for name, gait in GAITS.items()),
    # A policy that moves nine joints of twelve; the others follow the reference.
    (replace(get_robot("aliengo"), policy_joints=9), GAITS["aliengo"]),
    (get_robot("aliengo"), CALIBRATED),
    (get_robot("h1"), replace(GAITS["h1"], brake_m_s2=2.0, brake_rad_s2=3.0, last_steps=2)),
]


def shaken(robot: RobotSpec, rng: np.random.Generator) -> mujoco.MjData:
    """A simulation in any state at all, turned about any axis."""
    data = mujoco.MjData(robot.build_model())
    data.qpos[:] += rng.normal(0, 0.4, data.qpos.shape)
    mujoco.mju_normalize4(data.qpos[3:7])
    data.qvel[:] = rng.normal(0, 2.0, data.qvel.shape)
    return data


@pytest.mark.chain
@pytest.mark.parametrize("past", [0, 3])
@pytest.mark.parametrize(("robot", "gait"), CASES, ids=lambda case: getattr(case, "name", ""))
def test_a_robot_walks_alone_as_in_a_batch(robot: RobotSpec, gait: GaitClock, past: int) -> None:
    rng = np.random.default_rng(3)
    data = shaken(robot, rng)
    handles = RobotHandles.find(robot, data.model)
    step = QuickStep(data, handles, gait, 50.0, past, np.float64)
    joints, default = robot.policy_joints, robot.default_joint_rad
    clock, action, seen = ClockState.standing(1), np.zeros((1, joints)), None
    for k in range(120):
        data.qpos[:] = shaken(robot, rng).qpos
        data.qvel[:] = rng.normal(0, 2.0, data.qvel.shape)
        # Beyond the limits, within them, and standing still for a while.
        command = rng.normal(0, 0.6, 3) * (k % 40 < 15)
        wanted = robot.command_limits.clip(command[None])
        clock, moving = gait.tick(clock, wanted, 1 / 50.0)
        phase, wanted = clock.phase, gait.aimed(clock.command)
        now = observe(
            states_of(data.qpos[None], data.qvel[None], handles),
            default[:joints],
            wanted,
            phase,
            moving,
            action,
        )
        seen = remember(now, seen, joints, past)
        np.testing.assert_allclose(step.look(*command), seen, rtol=0, atol=1e-12)
        output = rng.normal(0, 3.0, (1, joints)).astype(np.float32)
        action = np.clip(output.astype(np.float64), -4.0, 4.0)
        targets = joint_targets(default, gait.reference(phase, moving, wanted), 0.5, action)[0]
        np.testing.assert_allclose(step.targets(output, 4.0, 0.5), targets, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(step.action, action)
        assert step.phase == pytest.approx(phase, abs=1e-12)


def test_a_policy_goes_on_in_another_simulation_and_forgets_on_reset() -> None:
    robot = get_robot("aliengo")
    policy, twin = GaitPolicy.load(robot), GaitPolicy.load(robot)
    model = robot.build_model()
    first, second = mujoco.MjData(model), mujoco.MjData(robot.build_model())
    command = (0.5, 0.0, 0.2)
    for _ in range(5):
        policy.act(first, command)
        twin.act(first, command)
    assert policy.phase == twin.phase == pytest.approx(5 * 0.04 % 1)
    assert np.array_equal(policy.act(second, command), twin.act(first, command))
    policy.reset()
    assert policy.phase == 0.0
    assert np.array_equal(
        policy.act(first, command), GaitPolicy.load(robot).act(first, np.array(command))
    )
