"""Sampling paths from one storey to another."""

import re
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.paths import path_clearance
from tests.support.scenes.storeys import HEAD_X, LENGTH_M, LINE, TOP_M, write_two_storeys
from vlnpe.formats.core.errors import InputError, SceneError
from vlnpe.formats.core.geometry import path_length
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.scene.sheet import save_sheet
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import SampleResult, sample_episodes
from vlnpe.trajectory_sampler.similarity import path_gap
from vlnpe.wayfinding.legs import legs_of
from vlnpe.wayfinding.storeys import Storeys

CONFIG = SampleConfig(count=4, min_length_m=3.0, min_view_m=0.0, storeys="cross")


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    return write_two_storeys(tmp_path_factory.mktemp("building"))


def sample(bundle: SceneBundle, seed: int = 0, **changes: Any) -> SampleResult:
    return sample_episodes(bundle, replace(CONFIG, **changes), np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_paths_lead_from_one_storey_to_the_other_and_keep_clear(
    building: SceneBundle, seed: int, tmp_path: Path
) -> None:
    result = sample(building, seed, count=6)
    assert result.missing == {}
    assert {e.levels for e in result.episodes} == {(0, 1), (1, 0)}
    storeys = Storeys.of(building, [1])
    for episode in result.episodes:
        assert episode.staircases == (1,)
        first, stairs, last = legs_of(building, episode)
        assert np.array_equal(stairs.path_m, LINE if episode.level == 0 else LINE[::-1])
        for leg in (first, last):
            assert np.allclose(leg.path_m[:, 2], TOP_M * leg.index)
            assert path_clearance(leg.sheet, leg.path_m).min() >= CONFIG.robot_radius_m
        path = episode.reference_path_world_m
        assert 3.0 <= path_length(path) - LENGTH_M <= 20.0
        goal, start = episode.goal_position_world_m, episode.start_position_world_m
        assert episode.geodesic_distance_m == pytest.approx(
            float(storeys.distance(goal).at(start)), abs=0.1
        )
        for end, leg in ((start, first), (goal, last)):
            assert path_length(leg.path_m) >= 2.0
            row, column = leg.sheet.grid.cell_of(end[:2])
            assert leg.sheet.clearance_m[row, column] >= CONFIG.end_clearance_m
        rooms = episode.extra["rooms"]
        assert {"hall", "landing"} <= set(rooms)
        assert (rooms[0] in ("kitchen", "hall")) == (episode.level == 0)
        waypoints = np.array(episode.extra["waypoints"]["position_world_m"])
        assert np.linalg.norm(np.diff(waypoints, axis=0), axis=1).max() <= 0.26
        assert min(episode.extra["waypoints"]["clearance_m"]) >= CONFIG.robot_radius_m
        x, y = start[:2]
        yaw = episode.start_yaw_rad
        for action in episode.extra["actions"][:-1]:
            if action == 1:
                x, y = x + 0.25 * np.cos(yaw), y + 0.25 * np.sin(yaw)
            else:
                yaw += np.deg2rad(15) * (1 if action == 2 else -1)
        assert np.hypot(x - goal[0], y - goal[1]) < 0.2
    for a, b in combinations(result.episodes, 2):
        if a.levels == b.levels:
            gap = path_gap(a.reference_path_world_m, b.reference_path_world_m)
            assert gap >= result.gap_m
    write_episodes(tmp_path / "e.json.gz", result.episodes)
    assert str(read_episodes(tmp_path / "e.json.gz")) == str(result.episodes)


def test_a_mixture_has_the_share_of_r2r_and_its_beginning_does_not_depend_on_its_size(
    building: SceneBundle,
) -> None:
    many, few = (
        sample(building, 1, count=count, storeys="mixed", min_gap_m=0.4, min_crossings=0).episodes
        for count in (21, 8)
    )
    assert Counter(len(e.staircases) for e in many) == {0: 17, 1: 4}
    assert [str(e) for e in few] == [str(e) for e in many[:8]]


def test_paths_stay_on_their_level_unless_others_are_wanted(building: SceneBundle) -> None:
    result = sample(building, 2, count=6, storeys="no")
    assert all(not e.staircases and "levels" not in e.extra for e in result.episodes)


def test_where_stairs_end_on_a_landing_paths_begin_and_end_on_it(tmp_path: Path) -> None:
    bundle = write_two_storeys(tmp_path)
    sheet = bundle.freemap(1)
    xs = sheet.grid.center_of(np.moveaxis(np.indices(sheet.grid.shape), 0, -1))[..., 0]
    landing = sheet.traversable & (xs < HEAD_X + 1.9)
    sheet = replace(
        sheet, traversable=landing, headroom_m=np.where(landing, sheet.headroom_m, np.float32(0.0))
    )
    save_sheet(bundle.level_folder(1), bundle.floor(1), bundle.obstacles(1), sheet)
    for episode in sample(bundle, count=2).episodes:
        ends = episode.reference_path_world_m[[0, -1]]
        ((x, y, _),) = ends[ends[:, 2] > 1.0]
        assert np.hypot(x - LINE[-1, 0], y - LINE[-1, 1]) >= 1.0 and x < HEAD_X + 1.9
        (below,) = ends[ends[:, 2] < 1.0]
        assert np.linalg.norm(below - LINE[0]) >= 2.0


def test_new_paths_keep_away_from_known_ones_over_the_same_stairs(building: SceneBundle) -> None:
    (known, *_) = sample(building, 3).episodes
    known = replace(known, split="val_seen")
    config = replace(CONFIG, count=6)
    result = sample_episodes(building, config, np.random.default_rng(4), avoid=[known])
    for episode in result.episodes:
        gap = path_gap(episode.reference_path_world_m, known.reference_path_world_m)
        assert gap >= config.family_gap_m or episode.levels != known.levels


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        ({"robot_radius_m": 0.65}, r"staircase 0 .* is a spiral; staircase 1 .* is 1.20 m wide"),
        ({"min_length_m": 60.0, "max_length_m": 70.0}, r"staircase 1 .*no_goal_in_range"),
    ],
)
def test_a_scene_without_a_way_up_says_of_each_staircase_why(
    building: SceneBundle, changes: dict[str, Any], reasons: str
) -> None:
    with pytest.raises(SceneError) as caught:
        sample(building, patience=3, **changes)
    assert re.search(reasons, str(caught.value))


def test_a_scene_on_one_level_is_refused_or_mixed_with_a_warning(
    two_rooms: SceneBundle, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(SceneError, match=r"has 1 level and none"):
        sample(two_rooms)
    assert len(sample(two_rooms, storeys="mixed", min_length_m=5.0, count=3).episodes) == 3
    assert "0 of 3 paths take a staircase; --storeys mixed asks for 1" in caplog.text


@pytest.mark.parametrize(
    "changes",
    [
        {"min_length_m": 9.3, "max_length_m": 11.0, "relax": False},  # levels are full first
        {"max_length_m": 6.0},  # staircases are
        {"max_length_m": 3.4},
    ],
)
def test_a_mixture_never_exceeds_its_share_and_says_what_it_lacks(
    building: SceneBundle, caplog: pytest.LogCaptureFixture, changes: dict[str, Any]
) -> None:
    changes = {"count": 30, "storeys": "mixed", "patience": 5, "min_crossings": 0, **changes}
    episodes = sample(building, **changes).episodes
    over_stairs, due = sum(bool(e.staircases) for e in episodes), round(0.19 * len(episodes))
    assert over_stairs <= due
    text = (
        f"{over_stairs} of {len(episodes)} paths take a staircase; --storeys mixed asks for {due}"
    )
    assert (text in caplog.text) == (over_stairs < due)


def test_other_choices_are_refused() -> None:
    with pytest.raises(InputError, match=r"valid: cross, mixed, no"):
        replace(CONFIG, storeys="croos")
