"""The same gaits in MuJoCo and in Drake."""

import sys

import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.second_engine import compare
from vlnpe.collectors.locomotion.second_engine.compare import ENGINES, GATES, Walk, walk
from vlnpe.collectors.locomotion.second_engine.worlds import DrakeWorld, MujocoWorld
from vlnpe.collectors.locomotion.training.gaits import GAITS
from vlnpe.collectors.locomotion.trials.gates import GateResult, worst_of
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.errors import MissingExtraError

WALKERS = [*GAITS, "go2"]  # the latter with classes in its model


def test_without_drake_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pydrake.geometry", None)
    with pytest.raises(MissingExtraError, match="extra `drake`"):
        DrakeWorld(get_robot("aliengo"), None)


def test_a_robot_that_is_pushed_over_counts_as_fallen():
    policy = GaitPolicy.load(get_robot("aliengo"))
    kicks = np.array([[0.0, 4.0], [0.0, 4.0]])
    outcome = walk(policy, MujocoWorld(policy.robot, None), Walk(np.array([0.5, 0, 0]), 0, kicks))
    assert outcome.fell and not outcome.fell_stopped


@pytest.mark.parametrize("name", WALKERS)
def test_both_engines_hold_the_same_robot(name: str):
    """Standing on its servos, it weighs and sags alike; kicked, it gets the same velocity."""
    pytest.importorskip("pydrake", reason="the extra drake is not installed")
    robot = get_robot(name)
    worlds = [engine(robot, None) for engine in ENGINES.values()]
    stand = np.tile(robot.default_joint_rad, (4, 1))
    heights = []
    for world in worlds:
        # A humanoid falls without its gait, but not in 0.2 s.
        for _ in range(10):
            world.advance(stand)
        heights.append(world.data.qpos[2])
        before = world.data.qvel[:6].copy()
        world.kick(np.array([0.3, -0.2]))
        np.testing.assert_allclose(world.data.qvel[:6] - before, [0.3, -0.2, 0, 0, 0, 0], atol=1e-9)
    assert abs(heights[0] - heights[1]) < 0.006, heights
    joints = [world.data.qpos[world.handles.joint_qpos] for world in worlds]
    np.testing.assert_allclose(joints[0], joints[1], atol=0.04)


def test_an_aliengo_walks_alike_in_both():
    pytest.importorskip("pydrake", reason="the extra drake is not installed")
    policy = GaitPolicy.load(get_robot("aliengo"))
    plan = Walk(np.array([0.6, 0.1, 0.4]), late_substeps=4)
    for engine in ENGINES.values():
        outcome = walk(policy, engine(policy.robot, None), plan)
        assert not outcome.fell
        assert outcome.linear_error_m_s < 0.05 and outcome.yaw_error_rad_s < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("name", WALKERS)
def test_gaits_pass_in_drake_with_other_commands(name: str):
    pytest.importorskip("pydrake", reason="the extra drake is not installed")
    policy = GaitPolicy.load(get_robot(name))
    table = compare.comparison(policy, count=3, seed=4, engines=("drake",))
    for gate in GATES:
        result = GateResult(gate, worst_of(gate, table))
        assert result.passed, result
