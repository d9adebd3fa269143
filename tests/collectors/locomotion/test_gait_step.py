"""The step of a gait: one robot as many, its history, and other simulations."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.gait import FACTORS, GaitClock
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.runtime.step import GaitStep
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
    rng, count, joints = np.random.default_rng(3), 3, robot.policy_joints
    data = [shaken(robot, rng) for _ in range(count)]
    handles = RobotHandles.find(robot, data[0].model)
    qpos, qvel = np.array([d.qpos for d in data]), np.array([d.qvel for d in data])
    limits, alone = robot.command_limits, replace(robot, action_scale_rad=0.5)
    handles = replace(handles, robot=alone)
    kind: Any = {"past": past, "dtype": np.float64}
    batch = GaitStep(qpos, qvel, handles, gait, limits, **kind)
    steps = [GaitStep(qpos[n : n + 1], qvel[n : n + 1], handles, gait, limits, **kind)
             for n in range(count)]  # fmt: skip
    history: list[np.ndarray] = []
    for k in range(60):
        for n in range(count):
            qpos[n], qvel[n] = shaken(robot, rng).qpos, rng.normal(0, 2.0, qvel.shape[1])
        # Beyond the limits, within them, and standing still for a while.
        command = rng.normal(0, 0.6, (count, 3)) * (k % 30 < 12)
        output = rng.normal(0, 3.0, (count, joints)).astype(np.float32)
        previous = batch.action.copy()
        seen, targets = batch.observe(command).copy(), batch.targets(output, 4.0)
        for n, step in enumerate(steps):
            np.testing.assert_array_equal(step.observe(command[n : n + 1])[0], seen[n])
            np.testing.assert_array_equal(step.targets(output[n : n + 1], 4.0)[0], targets[n])
        default = robot.default_joint_rad
        expected = [qpos[:, handles.joint_qpos] - default, qvel[:, handles.joint_dof]]
        history.append(np.hstack([*(e[:, :joints] for e in expected), previous]))
        repeated = [history[max(k - ago, 0)] for ago in range(past + 1)]
        np.testing.assert_array_equal(seen[:, 14:], np.hstack(repeated))
        np.testing.assert_array_equal(batch.action, np.clip(output.astype(np.float64), -4.0, 4.0))
        clock = batch.clock
        reference = gait.reference(clock.phase, clock.moving, gait.aimed(clock.command))
        reference[:, :joints] += 0.5 * batch.action
        np.testing.assert_allclose(targets, default + reference, rtol=0, atol=1e-12)


def test_some_robots_start_again_while_others_go_on() -> None:
    robot = get_robot("aliengo")
    data = shaken(robot, np.random.default_rng(0))
    handles = RobotHandles.find(robot, data.model)
    qpos, qvel = np.repeat(data.qpos[None], 2, 0), np.repeat(data.qvel[None], 2, 0)
    step = GaitStep(qpos, qvel, handles, GAITS["aliengo"], robot.command_limits)
    for _ in range(5):
        step.observe((0.5, 0.0, 0.0))
        step.targets(np.ones((2, 12), np.float32), 1.0)
    step.reset(np.array([1]))
    assert step.clock.phase[0] > 0.0 == step.clock.phase[1]
    assert step.action[0].any() and not step.action[1].any()


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
