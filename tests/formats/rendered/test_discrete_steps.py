"""Discrete steps of a walk: executing them leads where the robot went, and turns as much."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vlnpe.formats.core.rollout import Action
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute, total_turning

FORWARD, LEFT, RIGHT, STOP = Action.FORWARD, Action.LEFT, Action.RIGHT, Action.STOP


def walk(turns: list[float], speeds: list[float], sway: float = 0.0) -> np.ndarray:
    """Poses (N, 3) at 4 frames/s: each second has a turn rate [rad/s] and a speed [m/s]."""
    rate, speed = np.repeat(turns, 100), np.repeat(speeds, 100)
    time = np.arange(len(rate) + 1) / 100
    yaw = np.concatenate([[0.0], np.cumsum(rate) / 100])
    step = np.stack([speed * np.cos(yaw[:-1]), speed * np.sin(yaw[:-1])], 1) / 100
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])
    return np.column_stack([xy, yaw + sway * np.sin(9.0 * time)])[::25]


def turning(actions: np.ndarray) -> float:
    return 15.0 * ((actions == LEFT) | (actions == RIGHT)).sum()


@given(actions=st.lists(st.sampled_from([FORWARD, LEFT, RIGHT]), max_size=60), yaw=st.floats(-3, 3))
def test_exact_actions_are_their_own_steps(actions: list[Action], yaw: float) -> None:
    done = np.array([*actions, STOP], dtype=np.int64)
    poses = execute(done, np.array([1.0, -2.0, yaw]))[:-1]
    steps = discrete_steps(poses)
    assert steps.action.tolist() == done.tolist()
    assert steps.frame.tolist() == list(range(len(done)))
    np.testing.assert_allclose(steps.pose, poses, atol=1e-9)


def test_exact_actions_are_found_between_frames_that_stand_still() -> None:
    done = np.array([FORWARD, LEFT, FORWARD, RIGHT, STOP])
    poses = np.repeat(execute(done, np.zeros(3))[:-1], 5, axis=0)
    steps = discrete_steps(poses)
    assert steps.action.tolist() == done.tolist()
    np.testing.assert_allclose(poses[steps.frame], steps.pose, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    turns=st.lists(st.floats(-0.8, 0.8), min_size=4, max_size=20),
    speeds=st.lists(st.floats(0.0, 1.0), min_size=20, max_size=20),
    sway=st.floats(0.0, 0.06),
)
def test_executing_the_steps_of_any_walk_ends_where_it_did(turns, speeds, sway) -> None:
    poses = walk(turns, speeds[: len(turns)], sway)
    steps = discrete_steps(poses)
    assert steps.action[-1] == STOP and (steps.action[:-1] != STOP).all()
    assert (np.diff(steps.frame) >= 0).all() and steps.frame[-1] == len(poses) - 1
    done = execute(steps.action, poses[0])
    np.testing.assert_allclose(done[:-1], steps.pose, atol=1e-9)
    assert np.hypot(*(done[-1, :2] - poses[-1, :2])) <= 0.5
    assert np.rad2deg(abs(done[-1, 2] - np.unwrap(poses[:, 2])[-1])) <= 22.5
    # What is seen before an action is about what the agent that executes them would see.
    off = poses[steps.frame, :2] - steps.pose[:, :2]
    assert np.hypot(*off.T).max() <= 0.8


def test_total_turning_agrees_at_the_resolution_of_a_turn() -> None:
    """Walks through a building: straight stretches and turns, with a humanoid's sway."""
    rng, excess_deg, apart_m = np.random.default_rng(4), [], []
    for _ in range(40):
        count = int(rng.integers(8, 16))
        turns = np.where(rng.random(count) < 0.7, 0.0, rng.uniform(-0.8, 0.8, count))
        poses = walk(turns.tolist(), rng.uniform(0.4, 0.8, count).tolist(), 0.04)
        steps = discrete_steps(poses)
        excess_deg.append(turning(steps.action) - np.rad2deg(total_turning(poses[:, 2])))
        apart_m.append(np.hypot(*(execute(steps.action, poses[0])[-1, :2] - poses[-1, :2])))
    assert np.quantile(np.abs(excess_deg), 0.95) <= 15.0
    assert abs(np.mean(excess_deg)) <= 4.0
    assert np.quantile(apart_m, 0.95) <= 0.3


@pytest.mark.parametrize(
    ("headings_deg", "total_deg"),
    [
        ([0.0], 0.0),
        ([0, 14, 0, -14, 0], 28.0),  # one swing of 28°, between the extremes
        ([0, 14, 0, 14, 0], 0.0),
        ([0, 20, 40, 35, 40, 0], 80.0),
        ([0, -15, 0], 30.0),
        ([0, 90, 180, 270, 360], 360.0),
    ],
)
def test_swings_of_a_whole_turn_count(headings_deg: list[float], total_deg: float) -> None:
    assert np.rad2deg(total_turning(np.deg2rad(headings_deg))) == pytest.approx(total_deg)


@given(actions=st.lists(st.sampled_from([FORWARD, LEFT, RIGHT]), max_size=40))
def test_total_turning_of_exact_actions_is_their_number(actions: list[Action]) -> None:
    done = np.array([*actions, STOP], dtype=np.int64)
    yaw = execute(done, np.zeros(3))[:, 2]
    assert np.rad2deg(total_turning(yaw)) == pytest.approx(turning(done))


def test_a_turn_on_the_spot_and_a_long_straight() -> None:
    steps = discrete_steps(walk([0.7854, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0]))
    assert steps.action.tolist() == [LEFT] * 3 + [FORWARD] * 12 + [STOP]
    assert (np.diff(steps.frame) == 1).mean() > 0.8


def test_rounding_each_frame_alone_loses_slow_turns_and_these_do_not() -> None:
    """A curve of 12°/s: 3° in each frame."""
    poses = walk([np.deg2rad(12.0)] * 10, [0.8] * 10)
    assert turning(discrete_steps(poses).action) == pytest.approx(120.0, abs=15.0)


def test_sway_and_standing_give_no_actions() -> None:
    poses = walk([0.0] * 8, [0.0] * 8, sway=0.08)
    assert discrete_steps(poses).action.tolist() == [STOP]


def test_a_stretch_walked_back_and_forth_counts_once() -> None:
    there = walk([0.0] * 6, [0.5, 0.5, -0.5, 0.5, 0.5, 0.5])
    assert (discrete_steps(there).action == FORWARD).sum() == 8


def test_one_frame_is_a_stop() -> None:
    steps = discrete_steps(np.zeros((1, 3)))
    assert (steps.frame.tolist(), steps.action.tolist()) == ([0], [STOP])


def test_other_frame_rates_give_about_the_same_steps() -> None:
    poses = walk([0.4, -0.4, 0.0, 0.6], [0.8] * 4)
    fine = np.stack([np.interp(np.arange(0, 16.01, 0.2), np.arange(17), c) for c in poses.T], 1)
    coarse, finer = discrete_steps(poses).action, discrete_steps(fine).action
    for action in (FORWARD, LEFT, RIGHT):
        assert abs(int((coarse == action).sum()) - int((finer == action).sum())) <= 1


def test_a_robot_that_is_thrown_about_is_followed_as_well_as_can_be() -> None:
    """A fall, or a jump in a damaged recording: 3 m sideways and half a turn in one frame."""
    poses = walk([0.0, 0.2], [0.5, 0.5])
    poses[5:] += (0.0, 3.0, np.pi)
    poses[7:] += (0.4, 0.0, -1.0)
    steps = discrete_steps(poses)
    assert steps.action[-1] == STOP
    assert np.isfinite(steps.pose).all()
