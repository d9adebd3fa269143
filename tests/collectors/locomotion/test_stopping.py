"""A gait stops without falling, soon and not far; gate (h), on the installed policies."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vlnpe.collectors.locomotion.runtime.gait import GaitClock
from vlnpe.collectors.locomotion.runtime.policy import GaitPolicy
from vlnpe.collectors.locomotion.trials.measures import GOAL_S, SPEEDS_M_S, stops
from vlnpe.collectors.locomotion.trials.pipe import TargetPipe
from vlnpe.collectors.locomotion.trials.terrain import noise_terrain
from vlnpe.collectors.robots import get_robot

pytestmark = pytest.mark.chain


def measured(policy: GaitPolicy, every: int = 12) -> dict:
    rng = np.random.default_rng(77)
    return stops(policy, noise_terrain(rng, 0.04), rng, every)


@cache
def installed(name: str) -> dict:
    return measured(GaitPolicy.load(get_robot(name)))


@pytest.mark.parametrize("name", ["aliengo", "h1", "g1"])
def test_installed_gaits_stop_upright(name: str):
    table = installed(name)
    assert table["robots"] >= 80
    # Without its brake the H1 falls in 70 % of these stops, the G1 in 46 %.
    assert table["falls"] <= 0.04 * table["robots"]
    assert table["rested"] >= 0.8
    distances = table["distance_m_p50"]
    # The faster, the farther; no gait stops at once, and none slides on for a metre.
    assert 0.02 < distances[0] < distances[-1] < 0.8


def test_the_card_lists_stopping_distances():
    for name in ("aliengo", "h1", "g1"):
        table = GaitPolicy.load(get_robot(name)).card.evaluation["stopping"]
        assert table["speed_m_s"] == list(SPEEDS_M_S)
        for key in ("distance_m_p50", "distance_m_p95", "rest_s_p99_by_speed"):
            assert len(table[key]) == len(SPEEDS_M_S)
        assert np.all(np.diff(table["distance_m_p50"]) > 0.0)
        assert np.all(np.less_equal(table["distance_m_p50"], table["distance_m_p95"]))


def test_a_humanoid_that_freezes_in_the_middle_of_a_step_falls():
    policy = GaitPolicy.load(get_robot("h1"))
    gait: GaitClock = replace(policy.card.gait, brake_m_s2=None, brake_rad_s2=None, last_steps=0)
    frozen = policy.changed(policy.robot, replace(policy.card, gait=gait))
    assert measured(frozen)["falls"] > installed("h1")["falls"]


def test_a_robot_that_never_rests_counts_with_the_whole_observation_time():
    policy = GaitPolicy.load(get_robot("aliengo"))
    # A clock that never ends its last steps.
    restless = replace(policy.card.gait, last_steps=1000)
    table = measured(policy.changed(policy.robot, replace(policy.card, gait=restless)), every=24)
    assert table["rest_s_p99"] > GOAL_S
    assert table["rested"] < 1.0


@pytest.mark.parametrize("late", [0, 1, 4, 5, 12])
def test_targets_arrive_as_many_physics_steps_late_as_asked_for(late: int):
    pipe = TargetPipe(np.array([late, 0]))
    pipe.fill(np.zeros((2, 1)))
    arrived = []
    for k in range(1, 8):
        arrived.append(pipe.push(np.full((2, 1), float(k)))[..., 0])
    first, second = np.concatenate(arrived, axis=1)
    given = np.repeat(np.arange(1.0, 8.0), 4)
    np.testing.assert_array_equal(second, given)
    np.testing.assert_array_equal(first[late:], given[: len(given) - late])
    assert np.all(first[:late] == 0.0)


def test_a_delay_line_can_be_refilled_for_single_robots():
    pipe = TargetPipe(np.array([8, 8]))
    pipe.fill(np.zeros((2, 1)))
    pipe.push(np.full((2, 1), 1.0))
    pipe.refill(np.array([1]), np.array([5.0]))
    arrived = pipe.push(np.full((2, 1), 2.0))[:, 0, 0]
    assert arrived.tolist() == [0.0, 5.0]
