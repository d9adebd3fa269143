"""The planning map: clearance, geodesic distance, paths."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.paths import path_clearance
from tests.support.scenes.rooms import PARTS
from vlnpe.formats.core.geometry import path_length, resample
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.wayfinding.distance import distance_field, nearest_cell
from vlnpe.wayfinding.geodesic import line_is_free
from vlnpe.wayfinding.planning import plan_path, segments_free, simplify_path

RADIUS = 0.3


def empty_map(rows=80, columns=120, cell=0.05):
    grid = GridSpec((-1.0, 2.0), cell, rows, columns)
    return Freemap(grid, np.zeros(grid.shape, np.float32), np.ones(grid.shape, bool))


def random_map(seed):
    rng = np.random.default_rng(seed)
    free = np.ones((40, 50), bool)
    for _ in range(rng.integers(0, 9)):
        r, c = rng.integers(0, 40), rng.integers(0, 50)
        free[r : r + rng.integers(1, 12), c : c + rng.integers(1, 12)] = False
    grid = GridSpec((0.0, 0.0), 0.1, 40, 50)
    return Freemap(grid, np.where(free, 0.0, np.nan).astype(np.float32), free)


def to_obstacles(points):
    """Distance (N,) of points to the nearest part of the two rooms."""
    low = np.array([p[2][:2] for p in PARTS])
    high = np.array([p[3][:2] for p in PARTS])
    nearest = np.clip(points[:, None], low, high)
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


def test_clearance_is_the_distance_to_the_nearest_obstacle(two_rooms):
    freemap = two_rooms.freemap(0)
    cells = np.argwhere(freemap.traversable)
    true = to_obstacles(freemap.grid.center_of(cells))
    clearance = freemap.clearance_m[freemap.traversable]
    assert np.abs(clearance - true).max() < freemap.grid.cell_m


@pytest.mark.parametrize("goal", [(0.3, 3.1), (2.0, 4.0), (4.97, 5.97)])
def test_distance_without_obstacles_is_straight(goal):
    freemap = empty_map()
    points = np.random.default_rng(0).uniform((-1, 2), (5, 6), (500, 2))
    distance = distance_field(freemap, goal).at(points)
    true = np.linalg.norm(points - np.array(goal), axis=1)
    assert np.all(distance >= true - 1e-9)
    assert np.abs(distance - true).max() < 0.02  # less than half a cell; 8-connected: 8 %


def test_distance_through_a_doorway_is_that_of_the_taut_string(two_rooms):
    freemap = two_rooms.freemap(0)
    # From the far corner of one room round the doorway's jamb to that of the other.
    start, goal = np.array([0.7, 0.6]), np.array([5.0, 0.6])
    true = path_length(np.array([start, (4 - 0.05, 1.5), (4 + 0.05, 1.5), goal]))
    assert true - 0.05 <= float(distance_field(freemap, goal).at(start)) <= true + 0.1


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_distances_are_symmetric_and_never_shorter_than_straight(seed):
    freemap = random_map(seed)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(freemap.traversable)
    a, b = freemap.grid.center_of(rng.choice(cells, 2))
    there = float(distance_field(freemap, a).at(b))
    back = float(distance_field(freemap, b).at(a))
    assert np.isfinite(there) == np.isfinite(back)
    if np.isfinite(there):
        assert there == pytest.approx(back, rel=0.02, abs=0.1)  # a cell
        assert there >= np.linalg.norm(a - b) - 1e-9


def test_unreachable_is_infinite_and_points_in_walls_snap(two_rooms):
    freemap = two_rooms.freemap(0)
    field = distance_field(freemap, (1.0, 1.0), RADIUS)
    assert np.isinf(field.at((-3.0, 1.0)))
    assert field.at((1.0, 1.0)) == 0.0
    in_wall = float(field.at((3.98, 0.7)))
    assert 2.9 < in_wall < 3.3
    assert field.at(np.zeros((2, 3, 2)) + 2.0).shape == (2, 3)


def test_goal_in_a_blocked_cell_is_reached_from_beside_it(two_rooms):
    freemap = two_rooms.freemap(0)
    field = distance_field(freemap, (0.9, 2.95), RADIUS)  # closer to the table than the radius
    assert float(field.at((0.9, 1.0))) == pytest.approx(1.95, abs=0.1)


def test_a_wall_one_cell_thick_blocks_sight_also_diagonally():
    free = np.ones((20, 20), bool)
    free[np.arange(20), np.arange(20)] = False
    assert not line_is_free(free, 5, 12, 12, 5)
    assert line_is_free(free, 2, 10, 8, 18)


def test_nearest_cell_looks_no_farther_than_asked():
    grid = GridSpec((0.0, 0.0), 0.1, 20, 20)
    mask = np.zeros(grid.shape, bool)
    mask[5, 5] = True
    assert nearest_cell(grid, mask, (0.55, 0.55), 0.0) == (5, 5)
    assert nearest_cell(grid, mask, (0.85, 0.55), 0.31) == (5, 5)
    assert nearest_cell(grid, mask, (0.85, 0.55), 0.29) is None
    assert nearest_cell(grid, mask, (-9.0, -9.0), 0.5) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_planned_paths_keep_their_clearance(two_rooms, seed):
    freemap = two_rooms.freemap(0)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(freemap.free(RADIUS))
    start, goal = freemap.grid.center_of(rng.choice(cells, 2))
    path = plan_path(freemap, start, goal, RADIUS)
    assert path is not None
    assert np.array_equal(path[0, :2], start)
    assert np.array_equal(path[-1, :2], goal)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.6
    thin = simplify_path(freemap, path, radius_m=RADIUS, spacing_m=1.0, tolerance_m=0.03)
    for line in (path, thin):
        assert to_obstacles(resample(line[:, :2], 0.01)).min() >= RADIUS - freemap.grid.cell_m
    geodesic = float(distance_field(freemap, goal, RADIUS).at(start))
    assert geodesic - 0.06 <= path_length(path) <= 1.25 * geodesic + 0.1
    assert path_length(thin) <= path_length(path) + 1e-9


def test_paths_prefer_the_middle_of_a_doorway(two_rooms):
    freemap = two_rooms.freemap(0)
    path = plan_path(freemap, (3.0, 0.6), (5.0, 0.6), 0.2)
    assert path is not None
    dense = resample(path, 0.02)
    in_door = dense[np.abs(dense[:, 0] - 4.0) < 0.1]
    assert np.abs(in_door[:, 1] - 2.0).max() < 0.2


def test_a_start_in_a_tight_spot_can_leave_it(two_rooms):
    freemap = two_rooms.freemap(0)
    path = plan_path(freemap, (2.0, 0.1), (2.0, 2.0), RADIUS)  # 0.1 m from the wall
    assert path is not None
    assert np.allclose(path[0, :2], (2.0, 0.1))
    assert path_length(path) < 2.2


def test_an_unreachable_goal_has_no_path(two_rooms):
    freemap = two_rooms.freemap(0)
    assert plan_path(freemap, (1.0, 1.0), (6.0, 3.0), 0.6) is None  # the doorway is 1 m wide
    assert plan_path(freemap, (-4.0, 1.0), (6.0, 3.0), RADIUS) is None


def test_same_start_and_goal_is_a_path_of_no_length(two_rooms):
    path = plan_path(two_rooms.freemap(0), (2.0, 2.0), (2.0, 2.0), RADIUS)
    assert path is not None
    assert path.shape == (2, 3)
    assert path_length(path) == 0.0


def test_path_heights_follow_the_floor():
    freemap = empty_map()
    rows, columns = np.indices(freemap.grid.shape)
    slope = (0.1 * freemap.grid.center_of(np.stack([rows, columns], -1))[..., 0]).astype(np.float32)
    sloped = Freemap(freemap.grid, slope, freemap.traversable)
    path = plan_path(sloped, (-0.5, 2.5), (4.5, 5.5), RADIUS)
    assert path is not None
    assert np.allclose(path[:, 2], 0.1 * path[:, 0], atol=0.003)


def test_segments_and_clearance_see_a_wall_between_waypoints(two_rooms):
    freemap = two_rooms.freemap(0)
    through_wall = np.array([[3.0, 0.7], [5.0, 0.7], [5.0, 2.0]])
    free = freemap.free(RADIUS)
    assert segments_free(freemap.grid, free, through_wall).tolist() == [False, True]
    assert path_clearance(freemap, through_wall).min() == 0.0
