"""Metrics: known values on the two-room scene and properties that always hold."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.support.scenes.storeys import HEAD_X, LENGTH_M, LINE, TOP_M, write_two_storeys
from vlnpe.collectors.replay.metrics import dtw, ndtw, rollout_metrics
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.geometry import path_length, space_evenly
from vlnpe.formats.core.rollout import EndReason
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.wayfinding.distance import AGENT_RADIUS_M, distance_field
from vlnpe.wayfinding.storeys import ground_of

POINTS = arrays(np.float64, st.tuples(st.integers(1, 12), st.just(2)), elements=st.floats(-9, 9))
REFERENCE = np.array([[1.0, 1.0, 0], [3.0, 2.0, 0], [5.0, 2.0, 0], [7.0, 3.0, 0]])


def episode(goal: tuple[float, float] = (7.0, 3.0)) -> Episode:
    return Episode(
        episode_id="1",
        trajectory_id="1",
        scene_id="two_rooms",
        split="train",
        level=0,
        start_position_world_m=REFERENCE[0],
        start_yaw_rad=0.0,
        goal_position_world_m=np.array([*goal, 0.0]),
        reference_path_world_m=REFERENCE,
        geodesic_distance_m=6.3,
    )


def walk(*corners: tuple[float, float], speed_m_s: float = 0.5) -> np.ndarray:
    """A 100 Hz track along corners, 0.36 m above the floor."""
    xy = space_evenly(np.array(corners, dtype=float), speed_m_s / 100)
    return np.column_stack([xy, np.full(len(xy), 0.36)])


def brute_dtw(a: np.ndarray, b: np.ndarray) -> float:
    """Recursion over all monotone alignments, straight from the definition."""
    here = float(np.linalg.norm(a[-1] - b[-1]))
    if len(a) == 1 and len(b) == 1:
        return here
    before = []
    if len(a) > 1:
        before.append(brute_dtw(a[:-1], b))
    if len(b) > 1:
        before.append(brute_dtw(a, b[:-1]))
    if len(a) > 1 and len(b) > 1:
        before.append(brute_dtw(a[:-1], b[:-1]))
    return here + min(before)


SHORT = arrays(np.float64, st.tuples(st.integers(1, 5), st.just(2)), elements=st.floats(-9, 9))


@settings(max_examples=40, deadline=None)
@given(SHORT, SHORT)
def test_dtw_is_the_true_minimum(a: np.ndarray, b: np.ndarray) -> None:
    assert dtw(a, b) == pytest.approx(brute_dtw(a, b), abs=1e-9)
    assert dtw(a, b) == pytest.approx(dtw(b, a), abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(POINTS, st.lists(st.integers(1, 3), min_size=12, max_size=12))
def test_ndtw_of_itself_is_one_at_any_pace(path: np.ndarray, pace: list[int]) -> None:
    assert ndtw(np.repeat(path, pace[: len(path)], axis=0), path) == pytest.approx(1.0)


@settings(max_examples=40, deadline=None)
@given(POINTS, POINTS)
def test_ndtw_lies_between_zero_and_one(path: np.ndarray, reference: np.ndarray) -> None:
    assert 0.0 <= ndtw(path, reference) <= 1.0


def test_a_perfect_walk(two_rooms: SceneBundle) -> None:
    track = walk(*[tuple(p[:2]) for p in REFERENCE])
    m = rollout_metrics(episode(), two_rooms.freemap(0), track, EndReason.SUCCESS)
    assert m.trajectory_length_m == pytest.approx(path_length(REFERENCE), rel=0.01)
    assert m.navigation_error_m == pytest.approx(0.0, abs=0.01)
    assert m.success
    assert m.oracle_success
    assert m.spl == pytest.approx(6.3 / path_length(REFERENCE), rel=0.02)
    assert m.ndtw > 0.97
    assert m.duration_s == pytest.approx((len(track) - 1) / 100)


def test_a_detour_costs_spl_and_ndtw(two_rooms: SceneBundle) -> None:
    straight = walk(*[tuple(p[:2]) for p in REFERENCE])
    detour = walk((1, 1), (1, 2.5), (3, 1), (3, 2), (5, 2), (5, 3.5), (7, 3))
    first, second = (
        rollout_metrics(episode(), two_rooms.freemap(0), track, EndReason.SUCCESS)
        for track in (straight, detour)
    )
    assert second.spl < first.spl
    assert second.ndtw < first.ndtw


def test_distance_goes_round_the_wall_not_through_it(two_rooms: SceneBundle) -> None:
    # Beside the goal, but in the other room: near as the crow flies, far on foot.
    track = walk((1.0, 1.0), (3.7, 0.3))
    m = rollout_metrics(episode((4.4, 0.3)), two_rooms.freemap(0), track, EndReason.STOPPED_FAR)
    assert m.navigation_error_euclidean_m == pytest.approx(0.7, abs=0.01)
    assert m.navigation_error_m > 2.5


@pytest.mark.parametrize("end", list(EndReason))
def test_only_a_stop_near_the_goal_is_success(two_rooms: SceneBundle, end: EndReason) -> None:
    track = walk((1, 1), (3, 2), (5, 2), (6, 2.5))
    m = rollout_metrics(episode(), two_rooms.freemap(0), track, end)
    assert m.success == (end.startswith(("success", "stopped")))
    assert m.spl == 0.0 or m.success
    assert m.oracle_success  # it came within 3 m in any case
    assert m.fall == (end is EndReason.FALL)
    assert m.stuck == (end is EndReason.STUCK)


def test_oracle_success_remembers_a_pass(two_rooms: SceneBundle) -> None:
    track = walk((1, 1), (3, 2), (5, 2), (3, 2), (1, 1))
    m = rollout_metrics(episode((5.5, 2.0)), two_rooms.freemap(0), track, EndReason.STOPPED_FAR)
    assert m.oracle_success
    assert not m.success


def test_standing_still(two_rooms: SceneBundle) -> None:
    m = rollout_metrics(episode(), two_rooms.freemap(0), walk((1, 1)), EndReason.COLLISION_START)
    assert m.trajectory_length_m == 0.0
    assert m.duration_s == 0.0
    assert not m.success
    assert math.isfinite(m.ndtw)


def test_the_shortest_way_is_that_of_the_reference_agent(two_rooms: SceneBundle) -> None:
    """A gap that a point slips through and Habitat's agent does not: the way round counts."""
    freemap = two_rooms.freemap(0)
    blocked = freemap.traversable.copy()
    column = int(freemap.grid.cell_of(np.array([4.0, 2.0]))[1])
    blocked[:, column - 1 : column + 1] = False
    row = int(freemap.grid.cell_of(np.array([4.0, 2.0]))[0])
    blocked[row : row + 2, column - 1 : column + 1] = True  # 0.1 m of a door, ajar
    ajar = replace(freemap, traversable=blocked)
    m = rollout_metrics(episode(), ajar, walk((1, 1), (3, 2)), EndReason.STOPPED_FAR)
    assert math.isinf(float(distance_field(ajar, (7.0, 3.0), AGENT_RADIUS_M).at((3.0, 2.0))))
    assert not m.success
    assert math.isfinite(float(distance_field(ajar, (7.0, 3.0)).at((3.0, 2.0))))


def test_outside_of_the_building_the_error_is_the_way_back_and_nothing_succeeds(
    two_rooms: SceneBundle,
) -> None:
    """A flash agent goes through walls; its NE stays finite, so that means exist."""
    freemap = two_rooms.freemap(0)
    outside = (7.0, -1.2)  # beyond the wall, near the goal
    m = rollout_metrics(episode((7.0, 1.0)), freemap, walk((1, 1), outside), EndReason.STOPPED_FAR)
    assert m.navigation_error_euclidean_m < 3.0
    assert m.navigation_error_euclidean_m <= m.navigation_error_m < 4.0
    assert not m.success


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    return write_two_storeys(tmp_path_factory.mktemp("building"))


@pytest.mark.parametrize("up", [True, False])
def test_metrics_over_storeys_are_three_dimensional(building: SceneBundle, up: bool) -> None:
    path = np.vstack([[6.0, 2.0, 0.0], LINE, [HEAD_X + 4.4, 2.0, TOP_M]])
    path = path if up else path[::-1]
    length = 4.0 + LENGTH_M + 4.0
    task = replace(
        episode(),
        level=0 if up else 1,
        start_position_world_m=path[0],
        goal_position_world_m=path[-1],
        reference_path_world_m=path,
        geodesic_distance_m=length,
        extra={"staircases": [1], "levels": [0, 1] if up else [1, 0]},
    )
    ground = ground_of(building, task)
    # The base sways with every step and keeps its height above the slope.
    track = space_evenly(path, 0.005)
    track[:, 2] += 0.36 + 0.01 * np.sin(np.arange(len(track)) / 7.0)
    track[0, 2] = path[0, 2] + 0.36
    whole = rollout_metrics(task, ground, track, EndReason.SUCCESS)
    assert whole.trajectory_length_m == pytest.approx(length, rel=0.02)
    assert whole.navigation_error_m == pytest.approx(0.0, abs=0.05)
    assert whole.success
    assert whole.spl > 0.97
    assert whole.ndtw > 0.97
    # Halfway up the flight, and on the plan near the goal but a storey away.
    middle = int(np.argmin(np.abs(track[:, 2] - 0.36 - 0.5 * TOP_M)))
    half = rollout_metrics(task, ground, track[: middle + 1], EndReason.STOPPED_FAR)
    assert half.navigation_error_m == pytest.approx(0.5 * length, abs=0.1)
    assert not half.success
    assert not half.oracle_success
    assert half.ndtw < whole.ndtw
    lost = path[[-1, -1]] * (1.0, 1.0, 0.0) + (0.0, 0.0, TOP_M - path[-1, 2] + 0.36)
    away = rollout_metrics(task, ground, np.vstack([track[:1], lost]), EndReason.STOPPED_FAR)
    assert away.navigation_error_euclidean_m == pytest.approx(TOP_M, abs=0.05)
    assert away.navigation_error_m > 3.0
    assert not away.success
