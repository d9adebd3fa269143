"""Habitat alignment and the stair filter."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal
from unicodedata import normalize

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.frames import world_to_habitat_position, world_to_habitat_rotation
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.vlnce.files import VlnceEpisode, VlnceFile, VlnceGoal, read_vlnce, write_episodes
from vlnpe.formats.vlnce.groups import group_by_path, instruction_ids
from vlnpe.trajectory_sampler.vlnce.align import align_episodes
from vlnpe.trajectory_sampler.vlnce.align_config import AlignConfig
from vlnpe.trajectory_sampler.vlnce.stairs import StairRules, filter_stairs, steep_step
from vlnpe.wayfinding.planning import segments_free

CONFIG = AlignConfig()


def foreign(path_world, name: int | str = 1, yaw=0.0, **changes) -> VlnceEpisode:
    path = world_to_habitat_position(np.asarray(path_world, dtype=float))
    record = VlnceEpisode(
        episode_id=name,
        trajectory_id=9,
        scene_id="mp3d/two_rooms/two_rooms.glb",
        start_position_habitat_m=path[0],
        start_rotation_xyzw=world_to_habitat_rotation(yaw),
        instruction_text="Go there.",
        instruction_tokens=(3,),
        goals=(VlnceGoal(path[-1], 3.0),),
        reference_path_habitat_m=path,
        info={"geodesic_distance": 99.0},
        extra={"novel": True},
    )
    return replace(record, **changes)


def align(*episodes, bundles: Any, config=CONFIG):
    return align_episodes(VlnceFile(Path("val_unseen.json.gz"), episodes), bundles, config)


GOOD = [(1.0, 1.0, 0.05), (2.0, 2.0, 0.0), (4.0, 2.0, -0.04), (6.5, 2.0, 0.0)]


def test_a_good_episode_keeps_its_place_and_lies_on_the_floor(two_rooms):
    result = align(foreign(GOOD, yaw=0.4), bundles={"two_rooms": two_rooms})
    assert result.rejected == []
    assert result.moved == []
    (episode,) = result.episodes
    assert np.allclose(episode.reference_path_world_m[:, :2], np.array(GOOD)[:, :2])
    assert np.allclose(episode.reference_path_world_m[:, 2], 0.0)
    assert episode.start_yaw_rad == pytest.approx(0.4)
    assert episode.split == "val_unseen"
    assert (episode.episode_id, episode.trajectory_id) == ("1", "9")
    assert episode.instruction == "Go there."
    assert episode.extra["novel"] is True
    assert episode.extra["source_info"] == {"geodesic_distance": 99.0}
    # Measured again: √2 + 2 + 2.5 m of straight lines, the shortest a little less.
    assert 5.5 < episode.geodesic_distance_m < 5.95


def test_the_scene_s_own_transform_is_applied(two_rooms):
    # A source turned by 90° about the vertical and shifted, as a levelled scan would be.
    angle = np.deg2rad(90)
    turn = np.array(
        [
            [np.cos(angle), -np.sin(angle), 0, 0.5],
            [np.sin(angle), np.cos(angle), 0, -0.25],
            [0, 0, 1, 1.0],
            [0, 0, 0, 1],
        ]
    )
    levelled = replace(two_rooms, habitat_to_world=turn @ two_rooms.habitat_to_world)
    back = np.linalg.inv(turn)
    source = np.array(GOOD) @ back[:3, :3].T + back[:3, 3]
    (episode,) = align(foreign(source, yaw=0.4), bundles={"two_rooms": levelled}).episodes
    assert np.allclose(episode.reference_path_world_m[:, :2], np.array(GOOD)[:, :2])
    assert episode.start_yaw_rad == pytest.approx(0.4 + angle)


def test_our_own_files_are_in_the_repaired_world_already(two_rooms, tmp_path):
    (episode,) = align(foreign(GOOD), bundles={"two_rooms": two_rooms}).episodes
    write_episodes(tmp_path / "a.json.gz", [episode])
    moved = replace(two_rooms, habitat_to_world=np.diag([1.0, 1.0, 1.0, 1.0]))
    result = align_episodes(read_vlnce(tmp_path / "a.json.gz"), {"two_rooms": moved})
    assert np.allclose(result.episodes[0].reference_path_world_m, episode.reference_path_world_m)


def test_a_start_in_collision_is_moved_and_recorded(two_rooms):
    path = [(1.0, 0.1, 0.0), *GOOD[1:]]  # 0.1 m from the wall
    result = align(foreign(path), bundles={"two_rooms": two_rooms})
    (episode,) = result.episodes
    ((name, distance),) = result.moved
    assert name == 1
    assert 0.15 <= distance <= 0.3
    start = episode.start_position_world_m
    assert two_rooms.freemap(0).free(0.3)[tuple(two_rooms.freemap(0).grid.cell_of(start[:2]))]
    assert np.linalg.norm(start[:2] - path[0][:2]) == pytest.approx(distance)
    assert episode.extra["alignment"]["start_moved_m"] == distance
    assert np.array_equal(episode.reference_path_world_m[0], start)


def test_a_blocked_straight_way_is_walked_round(two_rooms):
    path = [(3.0, 0.7, 0.0), (5.0, 0.7, 0.0)]  # straight through the wall
    (episode,) = align(foreign(path), bundles={"two_rooms": two_rooms}).episodes
    freemap = two_rooms.freemap(0)
    whole = episode.reference_path_world_m
    assert len(whole) > 3
    assert segments_free(freemap.grid, freemap.free(0.3), whole).all()
    assert episode.extra["alignment"]["detours"] == 1


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ([(-2.0, 1.0, 0.0), (6.0, 2.0, 0.0)], "no floor"),
        ([(1.0, 1.0, 0.0), (6.8, 0.6, 0.0)], "goal.*collision"),  # inside the sofa
        ([(0.9, 3.35, 0.0), (6.0, 2.0, 0.0)], "start.*collision"),  # inside the table
        ([(1.0, 1.0, 0.0), (4.0, 2.0, 0.0), (6.0, 2.0, 2.8)], "2.80 m above"),
        ([(1.0, 1.0, 0.0), (1.0, 1.0, 0.0)], "same place"),
    ],
)
def test_rejected_episodes_say_why(two_rooms, path, reason):
    result = align(foreign(path, name="x"), bundles={"two_rooms": two_rooms})
    assert result.episodes == []
    ((name, why),) = result.rejected
    assert name == "x"
    assert "\n" not in why
    assert re.search(reason, why), why


def test_a_robot_too_wide_for_the_door_cannot_get_there(two_rooms):
    result = align(
        foreign([(1.5, 1.5, 0.0), (6.5, 2.3, 0.0)]),
        bundles={"two_rooms": two_rooms},
        config=AlignConfig(robot_radius_m=0.6),
    )
    assert "not connected" in result.rejected[0][1]


def test_test_split_and_unknown_scenes_are_rejected_one_by_one(two_rooms):
    test_split = foreign(GOOD, name=1, goals=(), reference_path_habitat_m=np.zeros((0, 3)))
    elsewhere = foreign(GOOD, name=2, scene_id="mp3d/other/other.glb")
    result = align(test_split, elsewhere, foreign(GOOD, name=3), bundles={"two_rooms": two_rooms})
    assert [name for name, _ in result.rejected] == [1, 2]
    assert "test split" in result.rejected[0][1]
    assert "two_rooms" in result.rejected[1][1]
    assert len(result.episodes) == 1


class TwoLevels:
    """The two rooms, and the same again 3 m higher."""

    def __init__(self, bundle):
        self.bundle = bundle
        self.level_floor_z_m = (0.0, 3.0)
        self.habitat_to_world = bundle.habitat_to_world

    def freemap(self, level):
        low = self.bundle.freemap(0)
        return Freemap(low.grid, low.floor_z_m + np.float32(3.0 * level), low.traversable)


@pytest.mark.parametrize(("z", "level"), [(0.1, 0), (2.8, 1)])
def test_the_level_is_picked_by_height(two_rooms, z, level):
    path = [(1.0, 1.0, z), (4.0, 2.0, z), (6.0, 2.0, z)]
    (episode,) = align(foreign(path), bundles={"two_rooms": TwoLevels(two_rooms)}).episodes
    assert episode.level == level
    assert np.allclose(episode.reference_path_world_m[:, 2], 3.0 * level)


def test_a_path_between_levels_is_rejected(two_rooms):
    path = [(1.0, 1.0, 0.0), (4.0, 2.0, 1.5), (6.0, 2.0, 3.0)]
    result = align(foreign(path), bundles={"two_rooms": TwoLevels(two_rooms)})
    assert "levels" in result.rejected[0][1]


def climbing(heights, name=1):
    return foreign([(0.1 * k, 0.0, z) for k, z in enumerate(heights)], name=name)


@pytest.mark.parametrize(
    ("heights", "step"),
    [
        ([0.0, 0.3, 0.6, 0.9], None),  # exactly the limit each time, not representable
        ([0.0, 0.31], 0),
        ([0.0, 0.0, -0.5, 0.0], 1),
        ([1.7, 1.7], None),
        ([5.0], None),
    ],
)
def test_stair_rule(heights, step):
    assert steep_step(heights) == step


def test_filter_keeps_order_and_says_which_step():
    file = VlnceFile(
        Path("a.json"),
        (climbing([0, 0.1, 0.2], 1), climbing([0, 0.2, 0.6], 2), climbing([0, 0], 3)),
        {"word_list": []},
        {"kept_key": 1},
    )
    result = filter_stairs(file)
    assert [e.episode_id for e in result.kept.episodes] == [1, 3]
    assert result.kept.extra == {"kept_key": 1}
    assert result.kept.vocabulary == {"word_list": []}
    (dropped,) = result.dropped
    assert dropped.episode_id == 2
    assert set(dropped.reasons) == {"step"}
    assert "points 1 and 2" in dropped.reason
    assert "0.40" in dropped.reason
    assert len(filter_stairs(file, StairRules(max_step_m=0.5)).dropped) == 0


def test_filter_refuses_a_threshold_that_drops_everything():
    with pytest.raises(InputError, match="0"):
        StairRules(max_step_m=0.0)


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=20), st.floats(0.05, 1.0))
def test_reported_step_is_the_first_too_high(heights, limit):
    step = steep_step(heights, limit)
    sizes = np.abs(np.diff(heights))
    if step is None:
        assert np.all(sizes <= limit + 1e-9)
    else:
        assert sizes[step] > limit
        assert np.all(sizes[:step] <= limit + 1e-9)


def test_each_rule_and_their_combinations(two_rooms):
    tower: Any = {"two_rooms": TwoLevels(two_rooms)}
    ramp = [(1.0, 1.0, 0.0)] + [(4.0 + 0.1 * k, 2.0, 0.25 * k) for k in range(13)]
    file = VlnceFile(
        Path("val_seen.json.gz"),
        (
            foreign(GOOD, name=1, trajectory_id=1, instruction_text="Pass the stairs."),
            foreign(GOOD, name=2, trajectory_id=1, instruction_text="Take three steps, then stop."),
            # Small steps add up to the next level: only the scene tells.
            foreign(ramp, name=3, trajectory_id=2, instruction_text="Go upstairs."),
            foreign([(1.0, 1.0, 0.0), (2.0, 1.0, 0.5)], name=4, trajectory_id=3),
        ),
    )

    def dropped(rules, combine="any"):
        result = filter_stairs(file, StairRules(rules, combine), tower)
        return [d.episode_id for d in result.dropped], result.counts

    assert dropped(("step",))[0] == [4]
    assert dropped(("geometric",))[0] == [3]
    assert dropped(("text",))[0] == [1, 3]
    ids, counts = dropped(("step", "geometric", "text"))
    assert ids == [1, 3, 4]
    # (episodes, paths): the path of episode 1 is kept with its other episode.
    assert (counts.kept, counts.dropped) == ((1, 1), (3, 3))
    assert counts.by_rule == {"step": (1, 1), "geometric": (1, 1), "text": (2, 2)}
    assert dropped(("geometric", "text"), "all")[0] == [3]


STAIRS = {
    "en-US": ("Climb the staircase and stop.", "Go through the door and stop by the sofa."),
    "en-IN": ("You will walk down six steps.", "You are facing a glass door. Take two steps."),
    "hi-IN": ("सीढ़ियों से ऊपर जाओ।", "आप एक कांच के दरवाज़े के सामने खड़े हैं। दाईं ओर मुड़ें।"),
    "hi": ("सीढियां उतरो।", "सीधे जाओ और सोफे के पास रुको।"),
    "te-IN": ("మెట్లు ఎక్కండి.", "మీరు ఒక గాజు తలుపు ముందు నిలబడి ఉన్నారు."),
    "zh": ("上楼梯,然后停下。", "向前走,停在沙发旁边。"),
    "": ("మెట్ల మీదుగా కిందికి దిగండి", "तुम दरवाज़े के सामने खड़े हो।"),
}


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("language", STAIRS)
def test_stairs_are_known_in_every_language_of_rxr(
    language: str, form: Literal["NFC", "NFD"]
) -> None:
    source = {"instruction": {"language": language} if language else {}}
    episodes = tuple(
        foreign(GOOD, name=k, instruction_text=normalize(form, text), source=source)
        for k, text in enumerate(STAIRS[language])
    )
    result = filter_stairs(VlnceFile(Path("a.json"), episodes), StairRules(("text",)))
    assert [d.episode_id for d in result.dropped] == [0]
    assert not result.counts.not_judged


@pytest.mark.parametrize(
    ("text", "declared", "said"),
    [
        ("Gehen Sie die Treppe hinauf.", "de-DE", "de-DE"),
        ("Поднимитесь по лестнице.", "", "Cyrillic script"),
        ("Поднимитесь по лестнице.", "en-US", "Cyrillic script"),
        ("階段を上がってください", "ja", "ja"),
        ("Seedhiyon se upar jao.", "hi-IN", "hi-IN in Latin letters"),
        ("…", "", "no letters"),
    ],
)
def test_other_languages_are_said_not_to_be_judged(text: str, declared: str, said: str) -> None:
    source = {"instruction": {"language": declared}}
    episodes = tuple(
        foreign(GOOD, name=k, trajectory_id=1, instruction_text=t, source=source)
        for k, t in enumerate([text, text])
    )
    result = filter_stairs(VlnceFile(Path("a.json"), episodes), StairRules(("text", "step")))
    assert result.counts.not_judged == {"text": {f"with instructions in {said}": (2, 1)}}
    assert len(result.kept.episodes) == 2


def test_a_test_split_cannot_be_judged(two_rooms):
    test_split = foreign(GOOD, goals=(), reference_path_habitat_m=np.zeros((0, 3)))
    file = VlnceFile(Path("test.json.gz"), (test_split,))
    result = filter_stairs(file)
    assert len(result.kept.episodes) == 1
    assert result.counts.not_judged == {"step": {"without a reference path": (1, 1)}}
    elsewhere = VlnceFile(Path("a.json"), (foreign(GOOD, scene_id="mp3d/x/x.glb"),))
    judged = filter_stairs(elsewhere, StairRules(("geometric",)), {"two_rooms": two_rooms})
    assert judged.counts.not_judged == {"geometric": {"without a repaired scene": (1, 1)}}
    with pytest.raises(InputError, match="--scenes"):
        filter_stairs(file, StairRules(("geometric",)))


def test_a_blocked_waypoint_is_bypassed_and_recorded(two_rooms):
    blocked = (6.8, 0.6, 0.0)  # inside the sofa
    path = [(1.0, 1.0, 0.0), (4.0, 2.0, 0.0), blocked, (6.5, 3.0, 0.0)]
    result = align(foreign(path), bundles={"two_rooms": two_rooms})
    (episode,) = result.episodes
    changes = episode.extra["alignment"]
    assert [one["waypoint"] for one in changes["bypassed"]] == [2]
    assert changes["bypassed"][0]["position_world_m"] == list(blocked)
    assert result.changed["waypoints bypassed"] == 1
    freemap = two_rooms.freemap(0)
    whole = episode.reference_path_world_m
    assert segments_free(freemap.grid, freemap.free(0.3), whole).all()
    assert np.allclose(whole[-1, :2], path[-1][:2])


def test_too_many_blocked_waypoints_are_another_path(two_rooms):
    path = [(1.0, 1.0, 0.0), (6.8, 0.6, 0.0), (6.9, 0.6, 0.0), (6.5, 3.0, 0.0)]
    result = align(foreign(path), bundles={"two_rooms": two_rooms})
    assert "waypoints 1, 2" in result.rejected[0][1]


def test_snaps_in_height_are_recorded_with_their_size(two_rooms):
    result = align(foreign(GOOD), bundles={"two_rooms": two_rooms})
    snaps = result.episodes[0].extra["alignment"]["height_snaps"]
    assert snaps == [
        {"point": "start", "moved_m": -0.05},
        {"point": "waypoint 0", "moved_m": -0.05},
        {"point": "waypoint 2", "moved_m": 0.04},
    ]
    flat = align(foreign([(x, y, 0.02) for x, y, _ in GOOD]), bundles={"two_rooms": two_rooms})
    assert flat.episodes[0].extra["alignment"]["height_snaps"] == []


def test_a_wider_robot_moves_what_a_narrow_one_leaves(two_rooms):
    path = [(1.0, 0.42, 0.0), *GOOD[1:]]
    bundles = {"two_rooms": two_rooms}
    narrow = align(foreign(path), bundles=bundles)
    wide = align(foreign(path), bundles=bundles, config=AlignConfig(robot_radius_m=0.45))
    assert narrow.moved == []
    assert wide.moved
    assert wide.episodes[0].extra["alignment"]["robot_radius_m"] == 0.45
    (nudge, *_) = wide.episodes[0].extra["alignment"]["nudges"]
    assert nudge["point"] == "start"
    assert nudge["moved_m"] == pytest.approx(wide.moved[0][1], abs=1e-4)


def test_goals_may_be_moved_no_farther_than_starts():
    with pytest.raises(InputError, match="goals"):
        AlignConfig(max_start_nudge_m=0.2, max_goal_nudge_m=0.3)


def near_wall(start_off_m, goal_off_m):
    """A path whose ends lie so far from the lower wall; a robot of 0.3 m fits from 0.3 m on."""
    return [(1.0, start_off_m, 0.0), *GOOD[1:3], (5.5, goal_off_m, 0.0)]


@pytest.mark.parametrize(
    ("start_off_m", "goal_off_m", "kept"),
    [(0.08, 0.2, True), (0.08, 2.0, True), (0.2, 0.08, False), (1.0, 0.2, False)],
)
def test_no_goal_is_moved_by_more_than_its_start(two_rooms, start_off_m, goal_off_m, kept):
    raw = foreign(near_wall(start_off_m, goal_off_m))
    result = align(raw, bundles={"two_rooms": two_rooms})
    assert len(result.episodes) == kept
    for episode in result.episodes:
        changes = episode.extra["alignment"]
        assert changes["goal_moved_m"] <= changes["start_moved_m"]
    for _, reason in result.rejected:
        assert re.search(r"goal .* by 0\.\d\d m.*start by 0\.\d\d m.*--goal-beyond-start", reason)
    loose = AlignConfig(goal_beyond_start=True)
    (episode,) = align(raw, bundles={"two_rooms": two_rooms}, config=loose).episodes
    assert episode.extra["alignment"]["goal_moved_m"] <= loose.max_goal_nudge_m


def test_episodes_of_one_path_are_fitted_once(two_rooms):
    texts = [foreign(GOOD, name=k, instruction_text=f"Text {k}.") for k in range(3)]
    result = align(*texts, foreign(GOOD[::-1], name=9), bundles={"two_rooms": two_rooms})
    assert (len(result.episodes), result.paths) == (4, 2)
    assert [e.instruction for e in result.episodes[:3]] == ["Text 0.", "Text 1.", "Text 2."]
    groups = group_by_path(result.episodes)
    assert [len(g.extra["instructions"]) for g in groups[:1]] == [3]
    assert instruction_ids(groups[0]) == ["0", "1", "2"]
