"""Calibration maps commands so that a gait reaches them, symmetrically to left and right."""

from dataclasses import replace

import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.trials.aim import aimed, command_bounds
from vlnpe.collectors.locomotion.trials.trial import STEP_S, Conditions, Trial
from vlnpe.collectors.robots import get_robot

pytestmark = pytest.mark.chain

MIRROR = np.array([1.0, -1.0, -1.0])


def mean_error(policy: GaitPolicy, commands: np.ndarray) -> float:
    count = len(commands)
    rng = np.random.default_rng(5)
    trial = Trial(policy, Conditions(), np.zeros((count, 2)), np.zeros(count), rng)
    velocity = []
    for _ in range(round(4.0 / STEP_S)):
        trial.step(commands)
        if trial.time_s > 2.0:
            velocity.append(trial.velocity)
    return float(np.abs(np.mean(velocity, axis=0) - commands).mean())


def test_a_weak_robot_is_asked_for_more_and_then_obeys() -> None:
    robot = get_robot("aliengo")
    policy = GaitPolicy.load(robot)
    # A gait whose stride is far too short.
    short = tuple(tuple(0.3 * v for v in row) for row in policy.card.gait.forward_rad)
    plain = replace(policy.card.gait, forward_rad=short, aim=(), aim_limits=())
    weak = policy.changed(robot, replace(policy.card, gait=plain))
    most = command_bounds(robot.command_limits, 1.5)
    gait = aimed(weak, most, points=3, rounds=3)
    better = weak.changed(robot, replace(weak.card, gait=gait))
    commands = np.array([(0.7, 0.0, 0.0), (0.6, 0.0, 0.8), (0.6, 0.0, -0.8), (0.4, 0.2, 0.0)])
    assert mean_error(better, commands) < 0.7 * mean_error(weak, commands)
    targets = gait.aimed(commands)
    assert np.all((targets >= most[:, 0]) & (targets <= most[:, 1]))
    np.testing.assert_allclose(gait.aimed(commands * MIRROR), targets * MIRROR, atol=1e-12)


@pytest.mark.parametrize("name", ["aliengo", "h1", "g1"])
def test_installed_gaits_stay_within_what_they_were_trained_with(name: str) -> None:
    robot = get_robot(name)
    gait = GaitPolicy.load(robot).card.gait
    bounds = command_bounds(robot.command_limits)
    commands = np.random.default_rng(0).uniform(bounds[:, 0], bounds[:, 1], (500, 3))
    targets = gait.aimed(commands)
    if gait.aim:
        limits = np.array(gait.aim_limits)
        assert np.all((targets >= limits[:, 0]) & (targets <= limits[:, 1]))
    # Nothing is turned round: a command of some size is asked for in the same direction.
    large = np.abs(commands) > 0.6 * bounds[:, 1]
    assert np.all((np.sign(targets) == np.sign(commands))[large])
