"""Distances and legs over storeys, in a building whose distances are known by geometry."""

import gzip
import json
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path

from tests.support.scenes.storeys import HEAD_X, LENGTH_M, LINE, TOP_M, write_two_storeys
from vlnpe.collectors.replay.replay import ReplayConfig, replay_episode
from vlnpe.collectors.robots import get_robot
from vlnpe.evaluation.env import NavigationEnv
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.geometry import path_length, point_along
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.pipeline.stages.rollouts.replay_job import Walker, open_level
from vlnpe.wayfinding.distance import AGENT_RADIUS_M, distance_field
from vlnpe.wayfinding.legs import legs_of
from vlnpe.wayfinding.storeys import Storeys, ground_of

CELL_M = 0.05


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    return write_two_storeys(tmp_path_factory.mktemp("building"), CELL_M)


@pytest.fixture(scope="module")
def storeys(building: SceneBundle) -> Storeys:
    return Storeys.of(building, [1])


def jambs(wall_x: float, z: float) -> list[np.ndarray]:
    """The corners that a taut string bends around, in the doorway of a wall."""
    clear = 0.5 - AGENT_RADIUS_M
    return [np.array([wall_x + dx, 2 + dy, z]) for dx in (-0.1, 0.1) for dy in (-clear, clear)]


def true_distance(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Shortest ways through a graph of straight lines: both rooms' corners, and the staircase."""
    nodes = np.vstack([*jambs(5.0, 0.0), *jambs(HEAD_X + 5.0, TOP_M), LINE[[0, -1]], goal, points])
    wall = np.where(nodes[:, 2] < 1.0, 5.0, HEAD_X + 5.0)
    length = np.linalg.norm(nodes[:, None] - nodes, axis=2)
    # A line passes the wall where both of its ends are on one side, or it crosses the doorway.
    side = nodes[:, 0] - wall
    for i, a in enumerate(nodes):
        for j, b in enumerate(nodes):
            if (a[2] < 1.0) != (b[2] < 1.0):
                length[i, j] = np.inf
            elif side[i] * side[j] < 0:
                for edge in (-0.1, 0.1):
                    share = (wall[i] + edge - a[0]) / (b[0] - a[0])
                    if 0 <= share <= 1 and abs(a[1] + share * (b[1] - a[1]) - 2.0) > 0.401:
                        length[i, j] = np.inf
    foot, head = 8, 9
    length[foot, head] = length[head, foot] = LENGTH_M
    return shortest_path(np.where(np.isfinite(length), length, 0.0), indices=10)[11:]


def random_points(rng: np.random.Generator, count: int) -> np.ndarray:
    """Places on both levels, half a metre from all walls."""
    upper = rng.random(count) < 0.5
    x = rng.uniform(0.5, 4.4, count) + 5.0 * (rng.random(count) < 0.5) + HEAD_X * upper
    return np.column_stack([x, rng.uniform(0.5, 3.5, count), TOP_M * upper])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_distances_are_those_of_a_graph_of_straight_lines(storeys: Storeys, seed: int) -> None:
    points = random_points(np.random.default_rng(seed), 12)
    measured = storeys.distance(points[0]).at(points[1:])
    true = true_distance(points[1:], points[0])
    assert np.all(measured >= true - 0.02)
    assert np.abs(measured - true).max() < 0.1 + 0.01 * true.max()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_distances_are_symmetric_and_obey_the_triangle_inequality(
    storeys: Storeys, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = random_points(rng, 3)
    there = np.array([storeys.distance(goal).at(points) for goal in points])
    assert np.abs(there - there.T).max() < 0.1 + 0.02 * there.max()
    assert np.all(there[0] <= there[0, 1] + there[1] + 0.1)
    # From the middle of the flight too, whether up or down is nearer.
    on_flight = point_along(LINE, rng.uniform(0.5, LENGTH_M - 0.5))
    own = np.array([storeys.distance(goal).at(on_flight) for goal in points])
    assert np.all(np.abs(own[:, None] - own) <= there + 0.1)


def test_on_the_flight_lengths_are_three_dimensional(storeys: Storeys) -> None:
    goal = np.array([HEAD_X + 2.0, 2.0, TOP_M])
    along = np.linspace(0.0, LENGTH_M, 60)
    rest = 2.0 - 0.4
    measured = storeys.distance(goal).at(point_along(LINE, along))
    assert measured == pytest.approx(LENGTH_M - along + rest, abs=0.03)
    beside = point_along(LINE, 0.5 * LENGTH_M) + np.array([0.0, 0.3, 0.0])
    assert float(storeys.distance(goal).at(beside)) == pytest.approx(
        0.5 * LENGTH_M + rest + 0.3, abs=0.03
    )


def test_below_and_above_are_far_apart_and_one_level_is_as_before(
    building: SceneBundle, storeys: Storeys
) -> None:
    goal = np.array([2.0, 2.0, 0.0])
    cells = np.argwhere(building.freemap(0).free(0.3))
    xy = building.freemap(0).grid.center_of(cells)
    field = distance_field(building.freemap(0), goal[:2], AGENT_RADIUS_M)
    joined = storeys.distance(goal).at(np.column_stack([xy, np.zeros(len(xy))]))
    assert np.array_equal(joined, field.at(xy))
    above = storeys.distance(goal).at([HEAD_X + 1.0, 2.0, TOP_M])
    assert float(above) > LENGTH_M + 7.0


def episode(path: np.ndarray, **extra: Any) -> Episode:
    return Episode(
        "e", "e", "two_storeys", "train", int(path[0, 2] > 1.0), path[0], 0.0, path[-1], path, 9.0,
        extra=extra,
    )  # fmt: skip


UP = np.vstack([[2.0, 2.0, 0.0], [6.0, 2.0, 0.0], LINE, [HEAD_X + 7.0, 2.0, TOP_M]])


@pytest.mark.parametrize("up", [True, False])
def test_legs_lie_on_one_sheet_each_and_join(building: SceneBundle, up: bool) -> None:
    path, levels = (UP, [0, 1]) if up else (UP[::-1], [1, 0])
    legs = legs_of(building, episode(path, staircases=[1], levels=levels))
    assert [(leg.index, leg.is_stairs) for leg in legs] == [
        (levels[0], False),
        (1, True),
        (levels[1], False),
    ]
    assert np.array_equal(legs[1].path_m, LINE if up else LINE[::-1])
    for before, after in pairwise(legs):
        assert np.array_equal(before.path_m[-1], after.path_m[0])
    for leg in legs:
        row, column = leg.sheet.grid.cell_of(leg.xy_m).T
        floor_m = leg.sheet.floor_z_m[row, column]
        assert np.abs(floor_m - leg.path_m[:, 2]).max() <= TOP_M / 16 + 1e-6
    assert sum(path_length(leg.path_m) for leg in legs) == pytest.approx(path_length(path))


def test_a_path_on_one_level_is_one_leg(building: SceneBundle) -> None:
    flat = episode(UP[:3])
    (leg,) = legs_of(building, flat)
    assert (leg.index, leg.is_stairs) == (0, False)
    assert flat.levels == (0,)
    assert np.array_equal(leg.path_m, UP[:3])
    ground = ground_of(building, flat)
    assert isinstance(ground, Freemap)
    assert np.array_equal(ground.traversable, building.freemap(0).traversable)


@pytest.mark.parametrize(
    ("path", "extra", "reason"),
    [
        (UP, {"staircases": [0], "levels": [0, 1]}, r"is a spiral"),
        (UP, {"staircases": [7], "levels": [0, 1]}, r"valid: 0 … 1"),
        (UP[:3], {"staircases": [1], "levels": [0, 1]}, r"passes an end of staircase 1 at"),
        (UP, {"staircases": [1], "levels": [0, 2]}, r"from level 0 to level 2"),
    ],
)
def test_staircases_that_a_path_cannot_take_are_refused(
    building: SceneBundle, path: np.ndarray, extra: Mapping[str, Any], reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        legs_of(building, replace(episode(path), extra=dict(extra)))


def test_physics_opens_one_staircase_and_says_so(building: SceneBundle) -> None:
    assert episode(UP[:3]).staircase is None
    assert episode(UP, staircases=[1], levels=[0, 1]).staircase == 1
    twice = episode(UP, staircases=[1, 0], levels=[0, 1, 0])
    walker = Walker(get_robot("aliengo"), ReplayConfig("aliengo"))
    for take in (
        lambda: replay_episode(building, twice, walker.config),
        lambda: open_level(building.root, twice, walker, building.root),
        lambda: NavigationEnv(building.root, [twice], images=False),
    ):
        with pytest.raises(InputError, match=r"takes staircases 1, 0; valid: at most one"):
            take()


@pytest.mark.parametrize(
    "extra",
    [
        {"staircases": [1]},
        {"levels": [0, 1]},
        {"staircases": [1], "levels": [1, 0]},
        {"staircases": ["1"], "levels": [0, 1]},
        {"staircases": [-1], "levels": [0, 1]},
        {"staircases": 1, "levels": [0, 1]},
    ],
)
def test_a_file_with_other_routes_is_damaged(extra: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "train.json.gz"
    write_episodes(file, [episode(UP, staircases=[1], levels=[0, 1])])
    document = json.loads(gzip.decompress(file.read_bytes()))
    document["episodes"][0]["info"]["vlnpe"]["extra"] = extra
    file.write_bytes(gzip.compress(json.dumps(document).encode()))
    with pytest.raises(FileFormatError, match=r"info\.vlnpe is damaged"):
        read_episodes(file)
