"""Sampling episodes."""

import re
import shutil
from collections import Counter
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest

from tests.support.paths import path_clearance
from vlnpe.formats.core.errors import InputError, SceneError
from vlnpe.formats.core.frames import wrap_angle
from vlnpe.formats.core.geometry import path_length, point_along, resample
from vlnpe.formats.scene.bundle import LabeledObject, SceneBundle, load_bundle
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.level import visits
from vlnpe.trajectory_sampler.sampling import LEAST_GAP_M, sample_episodes
from vlnpe.trajectory_sampler.similarity import path_gap
from vlnpe.trajectory_sampler.view import SceneView
from vlnpe.wayfinding.crossings import crossings
from vlnpe.wayfinding.distance import AGENT_RADIUS_M, distance_field
from vlnpe.wayfinding.planning import segments_free
from vlnpe.wayfinding.regions import region_map

# Rooms of a few metres: the rule of open views has tests of its own.
CONFIG = SampleConfig(count=2, min_length_m=5.0, min_view_m=0.0)


def sample(bundle, seed=0, **changes):
    return sample_episodes(bundle, replace(CONFIG, **changes), np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(4))
def test_episodes_are_what_they_promise(two_rooms, seed):
    result = sample(two_rooms, seed)
    assert len(result.episodes) == 2
    freemap = two_rooms.freemap(0)
    regions = region_map(two_rooms, 0)
    for episode in result.episodes:
        path = episode.reference_path_world_m
        assert np.array_equal(path[0], episode.start_position_world_m)
        assert np.array_equal(path[-1], episode.goal_position_world_m)
        assert 5.0 <= path_length(path) <= 20.0
        assert segments_free(freemap.grid, freemap.free(CONFIG.robot_radius_m), path).all()
        assert path_clearance(freemap, path).min() >= CONFIG.robot_radius_m
        assert path_clearance(freemap, path[[0, 0]])[0] >= CONFIG.end_clearance_m
        assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 1.0 + 1e-6
        # The doorway is 1 m wide and at x = 4.
        (crossing,) = crossings(regions, path)
        assert abs(crossing.position_xy_m[0] - 4.0) < 0.5
        assert 0.8 <= crossing.width_m <= 1.2
        assert episode.extra["crossings"][0]["doorway"]
        assert sorted(episode.extra["rooms"]) == ["kitchen", "living room"]
        ahead = path[1] - path[0]
        off = wrap_angle(np.arctan2(ahead[1], ahead[0]) - episode.start_yaw_rad)
        assert abs(float(off)) < 0.6
        goal = distance_field(freemap, path[-1][:2], AGENT_RADIUS_M)
        assert episode.geodesic_distance_m == pytest.approx(float(goal.at(path[0][:2])), abs=0.1)


def test_paths_begin_and_end_with_an_open_view(two_rooms):
    view = SceneView(two_rooms)
    near = {}
    for least_m in (0.0, 1.0):
        episodes = sample(two_rooms, 1, count=6, min_length_m=3.0, min_view_m=least_m).episodes
        poses = []
        for episode in episodes:
            path = episode.reference_path_world_m
            last = path[-1] - point_along(path, path_length(path) - 0.4)
            first = point_along(path, 0.75) - path[0]
            poses += [(path[-1], last), (path[0], first)]
        near[least_m] = sum(
            not view.open_from(place, float(np.arctan2(step[1], step[0])), 0.7)
            for place, step in poses
        )
    assert near[0.0] > 0 == near[1.0]


def test_a_scene_without_open_ends_gives_paths_with_a_warning_or_none(two_rooms, caplog):
    result = sample(two_rooms, min_view_m=5.0, patience=2)
    assert len(result.episodes) == 2
    assert "accepted 2 without that" in caplog.text
    with pytest.raises(SceneError, match="end_at_wall"):
        sample(two_rooms, min_view_m=5.0, patience=2, relax=False)


def test_the_same_seed_gives_the_same_episodes(two_rooms):
    a, b, c = (sample(two_rooms, seed).episodes for seed in (3, 3, 4))
    assert str(a) == str(b)
    assert str(a) != str(c)


def test_the_first_paths_of_more_are_those_of_fewer(two_rooms):
    few, more = (sample(two_rooms, count=count).episodes for count in (2, 3))
    assert [len(few), len(more)] == [2, 3]
    assert [str(e) for e in few] == [str(e) for e in more[:2]]


@pytest.mark.parametrize("split", ["train", "val_seen"])
def test_new_paths_keep_away_from_those_to_avoid_whatever_their_split(two_rooms, split):
    config = replace(CONFIG, count=6, min_length_m=3.0)
    (known, *_) = sample(two_rooms, seed=5).episodes
    known = replace(known, split=split)
    found = [
        episode.reference_path_world_m
        for seed in range(3)
        for episode in sample_episodes(
            two_rooms, config, np.random.default_rng(seed), avoid=[known]
        ).episodes
    ]
    path = known.reference_path_world_m
    assert len(found) >= 6
    assert min(path_gap(new, path) for new in found) >= config.family_gap_m
    assert min(path_gap(new, path[::-1]) for new in found) >= config.family_gap_m


def test_episodes_survive_their_file(two_rooms, tmp_path):
    episodes = sample(two_rooms).episodes
    write_episodes(tmp_path / "e.json.gz", episodes)
    assert str(read_episodes(tmp_path / "e.json.gz")) == str(episodes)


def test_too_many_asked_for_gives_fewer_and_says_why(two_rooms):
    result = sample(two_rooms, count=900, min_length_m=6.0, patience=3)
    assert 2 <= len(result.episodes) < 900
    assert result.missing == {"train": 900 - len(result.episodes)}
    assert result.dropped["too_similar"] > 0
    assert f"{len(result.episodes)} of 900" in result.summary
    paths = [e.reference_path_world_m for e in result.episodes]
    for a, b in combinations(paths, 2):
        assert path_gap(a, b) >= LEAST_GAP_M


@pytest.mark.parametrize(
    "changes",
    [
        {"min_length_m": 30.0, "max_length_m": 40.0},
        {"robot_radius_m": 0.6},  # wider than the door
        {"robot_radius_m": 3.0},  # wider than the rooms
    ],
)
def test_no_episode_at_all_is_an_error_with_the_counts(two_rooms, changes):
    with pytest.raises(SceneError) as caught:
        sample(two_rooms, **changes)
    assert "two_rooms" in str(caught.value)
    rooms_hold_it = changes.get("robot_radius_m", 0.0) < 3.0
    assert ("m²" in str(caught.value)) == rooms_hold_it
    assert ("on no floor so wide" in str(caught.value)) != rooms_hold_it
    config = replace(CONFIG, **changes)
    assert f"{config.robot_radius_m:.2f} m of clearance along the way" in str(caught.value)
    assert f"{config.ends_m:.2f} m at both ends (--end-clearance-m)" in str(caught.value)
    if changes.get("min_length_m") == 30.0:
        # From corner to corner of the two rooms, round the jambs.
        longest = re.search(r"longest way .* is about ([\d.]+) m", str(caught.value))
        assert longest
        assert 7.0 < float(longest[1]) < 9.0
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"count": 0},
        {"min_length_m": 9.0, "max_length_m": 8.0},
        {"robot_radius_m": 0.0},
        {"end_clearance_m": 0.0},
    ],
)
def test_impossible_configurations_are_refused(changes):
    with pytest.raises(InputError, match="valid"):
        replace(CONFIG, **changes)


def test_less_room_to_turn_lets_paths_end_nearer_to_obstacles(two_rooms):
    freemap = two_rooms.freemap(0)

    def least(**changes):
        paths = [e.reference_path_world_m for e in sample(two_rooms, **changes).episodes]
        ends = [path[[end, end]] for path in paths for end in (0, -1)]
        return min(path_clearance(freemap, end).min() for end in ends)

    # In rooms of 4 m hardly any place is farther from all walls.
    with pytest.raises(SceneError, match=r"Less room to turn .*: --end-clearance-m 0\.3 --min-"):
        sample(two_rooms, end_clearance_m=1.9)
    assert least(end_clearance_m=1.0) >= 1.0
    assert 0.3 <= min(least(end_clearance_m=0.3, seed=seed) for seed in range(6)) < 0.45
    # A robot is never asked to stand where it is too wide.
    assert least(end_clearance_m=0.1, robot_radius_m=0.4, seed=1) >= 0.4


@pytest.mark.parametrize(("stop_x_m", "last"), [(4.3, "living room"), (3.7, "kitchen")])
def test_rooms_reach_to_the_doorway_that_a_path_ends_in(two_rooms, stop_x_m, last):
    regions = region_map(two_rooms, 0)
    path = np.array([[1.0, 2.0, 0.0], [stop_x_m, 2.0, 0.0]])
    there, back = visits(regions, path), visits(regions, path[::-1])
    assert regions.names[there.rooms[-1]] == regions.names[back.rooms[0]] == last
    assert [regions.names[room] for room in (there.rooms[0], back.rooms[-1])] == ["kitchen"] * 2
    assert there.steps == back.steps == 0  # it does not go well into the room


def test_a_single_room_gives_episodes_without_crossings(two_rooms, caplog):
    hall = LabeledObject("Hall", "room:hall", (0.0, 0.0, 0.0), (8.0, 4.0, 2.6), 0)
    result = sample(replace(two_rooms, objects=(hall,)))
    assert result.episodes
    assert all(e.extra["crossings"] == [] for e in result.episodes)
    assert "single room" in caplog.text


def test_levels_are_served_in_turn(two_rooms):
    class TwoLevels:
        """The two rooms, and the same again 3 m higher."""

        scene_id = "tower"
        level_floor_z_m = (0.0, 3.0)
        staircases = ()
        objects = two_rooms.objects

        def freemap(self, level):
            low = two_rooms.freemap(0)
            return Freemap(low.grid, low.floor_z_m + np.float32(3.0 * level), low.traversable)

        def floor(self, level):
            return two_rooms.floor(0)

        def obstacles(self, level):
            low = two_rooms.obstacles(0)
            return replace(low, center_m=low.center_m + np.array([0.0, 0.0, 3.0 * level]))

    episodes = sample(TwoLevels(), min_gap_m=0.5).episodes
    assert sorted(e.level for e in episodes) == [0, 1]
    for episode in episodes:
        assert np.allclose(episode.reference_path_world_m[:, 2], 3.0 * episode.level)


@pytest.fixture(scope="module")
def divided(two_rooms):
    quotas = {"train": 6, "val_seen": 3}
    config = replace(CONFIG, min_length_m=4.0, min_gap_m=0.8, family_gap_m=1.2, relax=False)
    return sample_episodes(two_rooms, config, np.random.default_rng(0), quotas)


def test_quotas_are_filled_and_splits_share_no_family(divided):
    assert Counter(e.split for e in divided.episodes) == {"train": 6, "val_seen": 3}
    assert divided.missing == {}
    paths = {s: [e for e in divided.episodes if e.split == s] for s in ("train", "val_seen")}
    for a, b in product(paths["train"], paths["val_seen"]):
        path, other = a.reference_path_world_m, b.reference_path_world_m
        assert path_gap(path, other) >= 1.2
        assert path_gap(path, other[::-1]) >= 1.2
        assert a.extra["similarity_group"] != b.extra["similarity_group"]
    for a, b in combinations(divided.episodes, 2):
        assert path_gap(a.reference_path_world_m, b.reference_path_world_m) >= 0.8


@pytest.mark.chain
def test_a_shortage_of_paths_is_counted_and_the_advice_works(two_rooms):
    config = replace(CONFIG, count=16, min_length_m=4.0, min_gap_m=2.0, relax=False, patience=6)
    result = sample_episodes(two_rooms, config, np.random.default_rng(0))
    assert result.missing["train"] == 16 - len(result.episodes) > 0
    for a, b in combinations(result.episodes, 2):
        assert path_gap(a.reference_path_world_m, b.reference_path_world_m) >= 2.0
    assert result.enough_at_m is not None
    followed = replace(config, min_gap_m=result.enough_at_m, patience=12)
    assert sample_episodes(two_rooms, followed, np.random.default_rng(0)).missing == {}


def test_waypoints_keep_their_clearance(two_rooms):
    for episode in sample(two_rooms).episodes:
        recorded = episode.extra["waypoints"]
        points = np.array(recorded["position_world_m"])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert steps[:-1] == pytest.approx(0.25, abs=0.02)
        assert points[-1] == pytest.approx(episode.goal_position_world_m, abs=1e-3)
        cells = two_rooms.freemap(0).grid.cell_of(points[:, :2])
        real = two_rooms.freemap(0).clearance_m[cells[:, 0], cells[:, 1]]
        assert np.array(recorded["clearance_m"]) == pytest.approx(real, abs=0.05)
        assert min(recorded["clearance_m"]) >= CONFIG.robot_radius_m


@pytest.mark.parametrize("heading", ["path", "random"])
def test_the_ideal_agent_s_actions_lead_to_the_goal(two_rooms, heading):
    for episode in sample(two_rooms, heading=heading, count=6, min_gap_m=0.5).episodes:
        x, y, yaw = *episode.start_position_world_m[:2], episode.start_yaw_rad
        path = episode.reference_path_world_m[:, :2]
        *actions, stop = episode.extra["actions"]
        assert (stop, 0 in actions) == (0, False)
        for action in actions:
            if action == 1:
                x, y = x + 0.25 * np.cos(yaw), y + 0.25 * np.sin(yaw)
                assert np.linalg.norm(resample(path, 0.05) - (x, y), axis=1).min() < 0.15
            else:
                yaw += np.deg2rad(15) * (1 if action == 2 else -1)
        assert np.hypot(*(path[-1] - (x, y))) < 0.2
        assert episode.extra["start_heading"] == heading


def test_paths_that_turn_too_much_are_dropped_and_counted(two_rooms):
    result = sample(two_rooms, max_turning_deg=12.0, count=3)
    assert all(e.extra["turning_deg"] <= 12.0 for e in result.episodes)
    assert result.dropped["turning"] > 0


def with_free(bundle, folder, change) -> SceneBundle:
    """Return a copy of a scene whose free cells `change` gives: (free, x [m], y [m]) → free."""
    root = folder / "changed"
    shutil.copytree(bundle.root, root)
    path = root / "levels" / "0" / "freemap.npz"
    arrays = dict(np.load(path))
    grid = bundle.freemap(0).grid
    x, y = np.moveaxis(grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1)), -1, 0)
    np.savez(path, **{**arrays, "traversable": change(arrays["traversable"], x, y)})
    return load_bundle(root)


def test_every_component_counts(two_rooms, tmp_path):
    """With the door closed both rooms are used, not only the larger one."""
    closed = with_free(two_rooms, tmp_path, lambda free, x, y: free & ~((x > 3.7) & (x < 4.3)))
    result = sample(closed, count=6, min_length_m=2.0, min_crossings=0, min_gap_m=0.8)
    sides = {bool(e.start_position_world_m[0] > 4.0) for e in result.episodes}
    assert sides == {True, False}
    for episode in result.episodes:
        assert len(set(episode.reference_path_world_m[:, 0] > 4.0)) == 1


def test_lengths_are_spread_over_what_the_scene_has(two_rooms):
    result = sample(two_rooms, count=12, min_length_m=3.0, min_gap_m=0.5, min_crossings=0)
    bins = Counter(int(e.reference_length_m // 2.0) for e in result.episodes)
    assert set(bins) >= {2, 3}


@pytest.mark.parametrize("seed", range(3))
def test_no_length_is_below_the_least_one(two_rooms, seed):
    for episode in sample(two_rooms, seed, min_length_m=4.0, count=6).episodes:
        assert episode.geodesic_distance_m >= 4.0
        assert path_length(episode.reference_path_world_m) >= 4.0


@pytest.fixture
def small_room(two_rooms, tmp_path):
    """The kitchen of `two_rooms` with its door closed: 4 × 4 m with a table."""
    return with_free(two_rooms, tmp_path, lambda free, x, y: free & (x < 3.9))


def test_a_small_room_gives_as_many_as_asked_for(small_room):
    result = sample(small_room, count=4, min_length_m=1.5, min_crossings=0)
    assert len(result.episodes) == 4
    paths = [e.reference_path_world_m for e in result.episodes]
    assert all(path_gap(a, b) >= 0.4 for a, b in combinations(paths, 2))


@pytest.fixture
def bedroom(two_rooms, tmp_path):
    """A furnished bedroom of 5 × 4 m, alone: bed, wardrobe, desk and chair leave 13 m²."""
    furniture = {"bed": (0, 2.1, 1.2, 2.8), "wardrobe": (3.0, 5, 3.4, 4)}
    furniture |= {"desk": (3.4, 5, 0, 0.7), "chair": (3.9, 4.4, 0.7, 1.1)}

    def change(free, x, y):
        free = (x > 0) & (x < 5) & (y > 0) & (y < 4)
        for x0, x1, y0, y1 in furniture.values():
            free &= ~((x > x0) & (x < x1) & (y > y0) & (y < y1))
        return free

    return replace(with_free(two_rooms, tmp_path, change), objects=())


@pytest.mark.chain
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_furnished_bedroom_gives_what_is_asked_for_or_says_why_not(bedroom, seed, caplog):
    """With the options that the README advises for a scan of one room."""
    advised = {"min_length_m": 2.0, "min_crossings": 0, "patience": 2}
    assert len(sample(bedroom, seed, count=4, **advised).episodes) == 4
    caplog.clear()
    found = sample(bedroom, seed, count=200, **advised).episodes
    assert 4 <= len(found) < 200
    assert "lower --min-length-m, or ask for fewer" in caplog.text
    # What the advice promises it keeps.
    shorter = sample(bedroom, seed, count=200, **{**advised, "min_length_m": 1.0}).episodes
    assert len(shorter) > len(found)
