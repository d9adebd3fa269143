"""Instructions: true to the path and the scene, in English, and checked."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import FileFormatError, UnknownNameError
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.instruction_gen import phrases
from vlnpe.instruction_gen.actions import find_turns, route_of
from vlnpe.instruction_gen.check import check_instruction, said_turns
from vlnpe.instruction_gen.compose import compose_instruction
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.landmarks import sightings
from vlnpe.instruction_gen.records import InstructConfig
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes
from vlnpe.wayfinding.regions import region_map

# Kitchen → through the door → past the sofa (on the right) to the east wall.
EAST = [(1.0, 2.0), (4.0, 2.0), (5.0, 2.0), (7.0, 1.6)]
# North along the west wall of the living room, then left through the door.
LEFT = [(5.2, 0.6), (5.2, 2.0), (3.0, 2.0), (0.9, 2.4)]


def episode_of(points, yaw=None, name="e-0"):
    path = np.column_stack([np.array(points, dtype=float), np.zeros(len(points))])
    ahead = path[1] - path[0]
    return Episode(
        episode_id=name,
        trajectory_id=name,
        scene_id="two_rooms",
        split="train",
        level=0,
        start_position_world_m=path[0],
        start_yaw_rad=float(np.arctan2(ahead[1], ahead[0])) if yaw is None else yaw,
        goal_position_world_m=path[-1],
        reference_path_world_m=path,
        geodesic_distance_m=6.0,
    )


def compose(episode, bundle, seed=0, style="detailed"):
    return compose_instruction(episode, bundle, np.random.default_rng(seed), style)


@pytest.mark.parametrize("style", ["concise", "detailed"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("points", [EAST, LEFT, EAST[::-1], LEFT[::-1]])
def test_instructions_pass_their_checks(two_rooms, points, seed, style):
    episode = episode_of(points)
    instruction = compose(episode, two_rooms, seed, style)
    assert check_instruction(instruction, episode, two_rooms) == []
    assert instruction.text[0].isupper()
    assert instruction.text.endswith(".")
    assert "  " not in instruction.text


def test_turn_room_and_goal_are_said(two_rooms):
    for seed in range(8):
        text = compose(episode_of(LEFT), two_rooms, seed).text
        assert said_turns(text) == ["left"]
        assert "kitchen" in text
        where_to_stop = re.split(r"stop|wait", text)[-1]
        assert "table" in where_to_stop
        assert "sofa" not in where_to_stop


def test_sides_are_those_of_the_walker(two_rooms):
    regions = region_map(two_rooms, 0)
    for points, side in (([*EAST[:3], (7.8, 2.0)], "right"), ([(7.8, 2.0), (4.5, 2.0)], "left")):
        seen = sightings(np.array(points), two_rooms, 0, regions)
        (sofa,) = [s for s in seen if s.category == "sofa"]
        assert sofa.side == side


def test_things_behind_walls_are_not_seen(two_rooms):
    regions = region_map(two_rooms, 0)
    along_the_wall = np.array([(3.6, 0.5), (3.6, 1.2)])
    assert [s.name for s in sightings(along_the_wall, two_rooms, 0, regions)] == []


def test_phrasings_vary_with_the_seed_and_repeat_with_it(two_rooms):
    texts = {compose(episode_of(EAST), two_rooms, seed).text for seed in range(30)}
    assert len(texts) >= 10
    assert compose(episode_of(EAST), two_rooms, 5) == compose(episode_of(EAST), two_rooms, 5)


def test_without_labels_turns_and_distances_are_enough(two_rooms):
    bare = replace(two_rooms, objects=())
    for points in (EAST, LEFT, [(0.8, 0.8), (0.8, 2.0), (3.0, 2.0)], [(1.0, 2.0), (3.5, 2.0)]):
        for seed in range(5):
            episode = episode_of(points)
            instruction = compose(episode, bare, seed)
            assert check_instruction(instruction, episode, bare) == []
            assert not instruction.landmarks
            assert "kitchen" not in instruction.text
    assert said_turns(compose(episode_of(LEFT), bare).text) == ["left"]
    straight = compose(episode_of([(1.0, 2.0), (3.1, 2.0)]), bare).text
    assert "two metres" in straight


def test_a_start_that_looks_away_begins_with_a_turn(two_rooms):
    instruction = compose(episode_of(EAST, yaw=np.pi), two_rooms)
    assert "around" in instruction.text.split(",")[0].split(".")[0].split(" and ")[0].lower()
    to_the_left = compose(episode_of(EAST, yaw=-np.pi / 2), two_rooms)
    assert said_turns(to_the_left.text)[0] == "left"


@given(st.lists(st.sampled_from([-90, -45, 45, 90]), min_size=0, max_size=4), st.floats(-3, 3))
@settings(max_examples=60, deadline=None)
def test_turns_of_a_path_are_found_with_their_angles(angles, heading):
    # Legs of 3 m: no two bends are one.
    headings = heading + np.concatenate([[0.0], np.cumsum(np.deg2rad(angles))])
    legs = 3.0 * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    path = np.concatenate([[[0.0, 0.0]], np.cumsum(legs, axis=0)])
    turns = find_turns(path, heading)
    assert [round(float(np.rad2deg(t.angle_rad))) for t in turns] == angles
    assert [t.along_m for t in turns] == pytest.approx([3.0 * (k + 1) for k in range(len(angles))])


def test_a_round_corner_is_one_turn():
    a = np.linspace(0, np.pi / 2, 12)
    arc = np.stack([4 + np.sin(a), 1 - np.cos(a)], axis=1)
    path = np.concatenate([[[0.0, 0.0]], arc, [[5.0, 5.0]]])
    (turn,) = find_turns(path, 0.0)
    assert np.rad2deg(turn.angle_rad) == pytest.approx(90, abs=5)


WRONG = [
    ("Turn right through the doorway into the kitchen and stop next to the table.", "right"),
    ("Turn left through the doorway, turn left again, then stop next to the table.", "turn 2"),
    ("Turn left into the kitchen, then walk on past the table to the far wall.", "where to stop"),
    ("Turn left and stop.", "words"),
    ("Turn left into the kitchen and then left of it " + "and on " * 50 + "stop.", "words"),
    ("Turn left into the bathroom, walk past the table and stop there.", "bathroom"),
    ("Turn left into the kitchen, walk past the bathtub and stop there.", "bathtub"),
    ("Turn left into the kitchen and stop at the refrigerator by the table.", "refrigerator"),
]


@pytest.mark.parametrize(("text", "complaint"), WRONG)
def test_false_texts_are_caught(two_rooms, text, complaint):
    problems = check_instruction(text, episode_of(LEFT), two_rooms)
    assert any(complaint in p for p in problems), problems


def test_far_things_must_not_be_named(two_rooms):
    episode = episode_of([(0.8, 2.0), (2.2, 2.0)])
    text = "Walk forward about one metre and stop when you can see the sofa."
    assert any("sofa" in p and "m from" in p for p in check_instruction(text, episode, two_rooms))


def test_false_records_are_caught(two_rooms):
    episode = episode_of(EAST)
    good = compose(episode, two_rooms)
    mention = good.landmarks[-1]
    for wrong, complaint in (
        (replace(mention, name="Piano_7"), "not in the scene"),
        (replace(mention, category="piano"), "not in the text"),
    ):
        bad = replace(good, landmarks=(wrong,))
        assert any(complaint in p for p in check_instruction(bad, episode, two_rooms))


def test_sides_are_checked(two_rooms):
    episode = episode_of([(7.8, 2.0), (4.5, 2.0), (1.0, 2.0)])
    for seed in range(20):
        good = compose(episode, two_rooms, seed)
        sided = [m for m in good.landmarks if m.side]
        if sided:
            other = "left" if sided[0].side == "right" else "right"
            bad = replace(good, landmarks=(replace(sided[0], side=other),))
            assert any("not on the" in p for p in check_instruction(bad, episode, two_rooms))
            return
    pytest.fail("no composed text named a side")


@pytest.mark.parametrize(
    ("text", "turns"),
    [
        ("Pass the sofa on your left and turn right.", ["right"]),
        ("Turn left around the table, then bear right.", ["left", "right"]),
        ("Turn around and take a left.", ["around", "left"]),
        ("Veer to the left with the bed on the right.", ["left"]),
    ],
)
def test_turns_are_read_from_the_text(text, turns):
    assert said_turns(text) == turns


def test_files_are_instructed_and_only_where_nothing_is_said(two_rooms, tmp_path):
    scenes = two_rooms.root.parent
    (scenes / "two_rooms").exists() or (scenes / "two_rooms").symlink_to(two_rooms.root)
    rng = np.random.default_rng(0)
    episodes = sample_episodes(two_rooms, SampleConfig(count=2), rng).episodes
    episodes.append(replace(episode_of(EAST), instruction="Somebody's own words."))
    result = instruct_episodes(episodes, scenes, InstructConfig(), np.random.default_rng(1))
    assert result.problems == {}
    assert [e.episode_id for e in result.episodes] == [e.episode_id for e in episodes]
    assert result.episodes[2].instruction == "Somebody's own words."
    assert len({e.instruction for e in result.episodes}) == 3
    for episode in result.episodes[:2]:
        assert check_instruction(episode.instruction, episode, two_rooms) == []
        facts = episode.extra["instruction"]
        assert facts["composer"] == "offline"
        assert json.loads(json.dumps(facts)) == facts
        assert episode.extra["rooms"]  # what the sampler wrote is kept
    write_episodes(tmp_path / "told.json.gz", result.episodes)
    assert str(read_episodes(tmp_path / "told.json.gz")) == str(result.episodes)
    again = instruct_episodes(
        result.episodes, scenes, InstructConfig(replace=True), np.random.default_rng(1)
    )
    assert again.episodes[2].instruction != "Somebody's own words."


def test_unknown_names_and_missing_scenes(tmp_path):
    rng = np.random.default_rng(0)
    with pytest.raises(UnknownNameError, match="offline"):
        instruct_episodes([], tmp_path, InstructConfig(composer="poet"), rng)
    with pytest.raises(UnknownNameError, match="concise"):
        InstructConfig(style="baroque")
    with pytest.raises(FileFormatError, match="two_rooms"):
        instruct_episodes([episode_of(EAST)], tmp_path, InstructConfig(), rng)


@pytest.mark.parametrize(
    ("category", "plural", "words"),
    [
        ("tv cabinet", False, "the TV cabinet"),
        ("chair", True, "the chairs"),
        ("bookshelf", True, "the bookshelves"),
        ("couch", True, "the couches"),
    ],
)
def test_names_of_things(category, plural, words):
    assert phrases.thing(category, plural) == words


def test_routes_name_rooms(two_rooms):
    route = route_of(episode_of(LEFT), region_map(two_rooms, 0))
    (change,) = route.changes
    assert (change.from_room, change.to_room, change.doorway) == ("living room", "kitchen", True)
    assert route.goal_room == "kitchen"
    assert asdict(route.turns[0])["angle_rad"] > 0
