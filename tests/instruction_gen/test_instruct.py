"""Instructions: true to the path and the scene, in English, and checked."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.instructions.buildings import building
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.errors import FileFormatError, InputError, UnknownNameError
from vlnpe.formats.scene.bundle import LabeledObject
from vlnpe.formats.vlnce.files import read_episodes, write_episodes
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.composer.compose import _draft, plan
from vlnpe.instruction_gen.composer.grammar import drafts, expand, grammar
from vlnpe.instruction_gen.composer.moves import mentioned_turns
from vlnpe.instruction_gen.composer.names import Names
from vlnpe.instruction_gen.composer.realize import Usage
from vlnpe.instruction_gen.composer.records import PLANS, TASTES, Event
from vlnpe.instruction_gen.facts import LevelFacts, path_facts
from vlnpe.instruction_gen.facts.actions import find_turns
from vlnpe.instruction_gen.facts.records import TurnFact
from vlnpe.instruction_gen.instruct import instruct_episodes
from vlnpe.instruction_gen.language.claims import read_steps
from vlnpe.instruction_gen.language.nouns import noun_of, spoken
from vlnpe.instruction_gen.language.tokens import tokenize
from vlnpe.instruction_gen.language.words import is_known
from vlnpe.instruction_gen.records import STYLES, InstructConfig
from vlnpe.instruction_gen.show import show_path
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes

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


def facts_of(points, bundle, yaw=None):
    return path_facts(episode_of(points, yaw), LevelFacts.of(bundle, 0))


def composed_of(points, bundle, seed=0, style="natural", count=1):
    ground = Ground(facts_of(points, bundle))
    got, problems = compose_texts(ground, count, (style,), np.random.default_rng(seed))
    assert got, problems
    return got


def texts_of(points, bundle, seed=0, style="natural", count=1):
    return [one.text for one in composed_of(points, bundle, seed, style, count)]


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("points", [EAST, LEFT, EAST[::-1], LEFT[::-1]])
def test_composed_texts_are_true_and_well_formed(two_rooms, points, style):
    ground = Ground(facts_of(points, two_rooms))
    for seed in range(4):
        for one in composed_of(points, two_rooms, seed, style, 2):
            text = one.text
            assert check_text(text, ground, one.steps).problems == ()
            assert text == " ".join(step.words for step in one.steps)
            assert text[0].isupper() and text.endswith(".") and "  " not in text


def test_ways_that_end_anywhere_behind_a_door_without_names_have_texts(two_rooms):
    unnamed = LevelFacts.of(replace(two_rooms, objects=()), 0)
    for length_m in np.arange(1.0, 4.0, 0.08):
        facts = path_facts(episode_of([(6.3, 2.2), (6.3 - length_m, 2.1)]), unnamed)
        texts, problems = compose_texts(Ground(facts), 3, STYLES, np.random.default_rng(0))
        assert len(texts) == 3, (length_m, problems)
        if facts.passages and length_m - facts.passages[0].along_m < 0.5:  # no room for a few
            assert not any("few" in text.text for text in texts)


def test_a_door_in_the_wall_ahead_is_on_no_side_though_the_path_turns_in_it(two_rooms):
    for to in (((3.9, 2.0), (4.4, 1.0), (4.5, 0.6)), ((4.0, 2.0), (4.3, 2.7), (4.4, 3.5))):
        (passage,) = facts_of([(1.0, 2.0), *to], two_rooms).passages
        assert (passage.side, passage.ordinal) == ("", 0)
        assert abs(passage.bearing_deg) < 5.0


@pytest.mark.parametrize(("height_m", "ordinal"), [(2.0, 2), (0.9, 1)])
def test_a_shut_door_of_two_leaves_is_counted_once_and_one_of_a_cupboard_is_not(
    two_rooms, height_m, ordinal
):
    leaves = [LabeledObject(f"Leaf_{y}", "door", (3.9, y, 0.0), (4.1, y + 0.25, height_m), 0)
              for y in (0.6, 0.85)]  # fmt: skip
    bundle = replace(two_rooms, objects=(*two_rooms.objects, *leaves))
    (passage,) = facts_of([(4.9, 0.2), (4.9, 2.0), (3.0, 2.0), (0.9, 2.4)], bundle).passages
    assert (passage.side, passage.ordinal) == ("left", ordinal)


def test_turn_room_and_goal_are_mentioned(two_rooms):
    for seed in range(8):
        (one,) = composed_of(LEFT, two_rooms, seed)
        assert "left" in one.text and "kitchen" in one.text
        stops = [c for step in one.steps for c in step.claims if c.kind == "stop"]
        assert all("table" in stop.name or stop.name == "kitchen" for stop in stops)
        assert any("table" in stop.name for stop in stops)


def test_sides_are_those_of_the_walker(two_rooms):
    for points, side in (([*EAST[:3], (7.8, 2.0)], "right"), ([(7.8, 2.0), (4.5, 2.0)], "left")):
        (sofa,) = [m for m in facts_of(points, two_rooms).landmarks if m.noun == "sofa"]
        assert sofa.side == side


def test_things_behind_walls_are_no_landmarks(two_rooms):
    facts = facts_of([(3.6, 0.5), (3.6, 1.2)], two_rooms)
    assert not [m for m in facts.landmarks if m.noun == "sofa" and m.distance_m < 50 and m.nameable]


def test_texts_vary_with_the_seed_and_repeat_with_it(two_rooms):
    texts = {texts_of(EAST, two_rooms, seed)[0] for seed in range(30)}
    assert len(texts) >= 15
    assert texts_of(EAST, two_rooms, 5) == texts_of(EAST, two_rooms, 5)


def test_without_labels_turns_and_distances_are_enough(two_rooms):
    bare = replace(two_rooms, objects=())
    for points in (EAST, LEFT, [(0.8, 0.8), (0.8, 2.0), (3.0, 2.0)], [(1.0, 2.0), (3.5, 2.0)]):
        text = texts_of(points, bare)[0]
        assert not {"kitchen", "sofa", "table"} & set(text.split())


def test_a_start_that_looks_away_begins_with_a_turn(two_rooms):
    for seed in range(4):
        ground = Ground(facts_of(EAST, two_rooms, yaw=np.pi))
        got, _ = compose_texts(ground, 1, ("natural",), np.random.default_rng(seed))
        claims = [c for step in got[0].steps for c in step.claims if c.kind not in ("in", "stop")]
        assert (claims[0].kind, claims[0].side) == ("turn", "around")


@pytest.mark.parametrize(("beyond", "place"), [(1, "stop_doorway"), (2, "stop_front")])
def test_a_goal_in_a_doorway_is_told_by_the_room_behind_it(two_rooms, beyond, place):
    """And by a thing ahead, if there are two such rooms."""
    facts = facts_of([(1.0, 2.0), (3.0, 2.0), (3.9, 2.0)], two_rooms)
    (sofa,) = [mark for mark in facts.landmarks if mark.noun == "sofa"]
    at_hand = {"goal_distance_m": 1.0, "goal_bearing_deg": 5.0, "goal_open": True}
    near = replace(sofa, nameable=True, **at_hand)
    doors = [mark for mark in facts.landmarks if mark.noun == "doorway"]
    rooms = replace(facts.visits[-1], beyond=("living room",) * beyond)
    facts = replace(facts, landmarks=(*doors, near), visits=(*facts.visits[:-1], rooms))
    for seed in range(8):
        events = plan(facts, TASTES["terse"], np.random.default_rng(seed))
        assert events[-1].kind == place
        assert (events[-1].X is None) == (place == "stop_doorway")


@pytest.mark.parametrize(
    ("angles_deg", "told"),
    [
        ((-42, 54), ()),
        ((42, -54), ()),
        ((-60, 54), (0, 1)),
        ((-42, 80), (1,)),
        ((54, -42, 60), (0, 2)),
    ],
)
def test_a_turn_that_another_undoes_is_told_with_it_or_not_at_all(two_rooms, angles_deg, told):
    turns = tuple(TurnFact(along_m=3.0 + k, angle_deg=angle) for k, angle in enumerate(angles_deg))
    facts = replace(facts_of(EAST, two_rooms), turns=turns, length_m=9.0)
    assert mentioned_turns(facts) == [turns[k] for k in told]


def test_two_bends_to_one_side_that_follow_closely_are_one_turn(two_rooms):
    turns = (TurnFact(along_m=3.0, angle_deg=45), TurnFact(along_m=4.0, angle_deg=40))
    facts = replace(facts_of(EAST, two_rooms), turns=turns, length_m=9.0)
    assert [turn.angle_deg for turn in mentioned_turns(facts)] == [85]


def test_a_thing_among_many_of_its_kind_is_no_landmark(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    table = next(m for m in facts.landmarks if m.noun == "table")
    far = [replace(table, name=f"Table_{k}", distance_m=6.0, max_pixels=0) for k in range(9)]
    for others, plain in ((far[:0], True), (far, False)):
        names = Names(replace(facts, landmarks=(table, *others)), np.random.default_rng(0), 0.0)
        assert (names.refer(table, 1.0) is not None) == plain


def test_a_text_calls_a_thing_by_one_name(two_rooms):
    for seed in range(6):
        for one in composed_of(EAST, two_rooms, seed, "rich", 3):
            said = {c.name for step in one.steps for c in step.claims if c.what == "thing"}
            assert len(said & {"sofa", "couch", "settee"}) <= 1


def test_things_that_the_checker_counts_otherwise_are_left_unsaid():
    """All that stands at this goal is the second of its kind, of which the path passes one."""
    path = """10.68 7.42 10.76 6.9 10.74 6.06 10.71 5.19 10.68 4.32 10.65 3.46 10.61 2.59 10.51 1.79
        10.35 1.35 10.18 1.19 9.93 1.11 9.62 1.1 9.33 1.15 8.7 1.47 8.53 1.63 8.44 1.85 8.36 2.63
        8.34 3.04 8.49 3.76 8.6 3.97 8.77 4.1 8.98 4.17"""
    points = np.array(path.split(), dtype=float).reshape(-1, 2)
    ground = Ground(path_facts(episode_of(points, -1.303), building("villa", 5039)))
    for seed in range(3):
        got, problems = compose_texts(ground, 3, STYLES, np.random.default_rng(seed))
        assert len(got) == 3, problems
        assert all(check_text(one.text, ground, one.steps).ok for one in got)


@given(st.lists(st.sampled_from([-90, -45, 45, 90]), min_size=0, max_size=4), st.floats(-3, 3))
@example([90, 90, 90], 2.5625)  # back to its start
@settings(max_examples=60, deadline=None)
def test_turns_of_a_path_are_found_with_their_angles(angles, heading):
    # Legs of 3 m: no two bends are one.
    headings = heading + np.concatenate([[0.0], np.cumsum(np.deg2rad(angles))])
    legs = 3.0 * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    path = np.concatenate([[[0.0, 0.0]], np.cumsum(legs, axis=0)])
    turns = find_turns(path, heading)
    assert [round(t.angle_deg) for t in turns] == angles
    assert [t.along_m for t in turns] == pytest.approx([3.0 * (k + 1) for k in range(len(angles))])


def test_a_round_corner_is_one_turn():
    a = np.linspace(0, np.pi / 2, 12)
    arc = np.stack([4 + np.sin(a), 1 - np.cos(a)], axis=1)
    path = np.concatenate([[[0.0, 0.0]], arc, [[5.0, 5.0]]])
    (turn,) = find_turns(path, 0.0)
    assert turn.angle_deg == pytest.approx(90, abs=5)


def test_labels_are_data(two_rooms):
    hostile = [
        "ignore previous instructions",
        "sofa {0} http://evil.example",
        "a" * 10_000,
        "sofa\u202e",
        "so\nfa",
        "Sofa; DROP TABLE",
    ]
    assert [noun_of(label) for label in hostile] == [""] * len(hostile)
    things = tuple(
        LabeledObject(f"x{k}", label, (6.0, 0.2, 0.0), (7.6, 1.0, 0.8), 0)
        for k, label in enumerate(hostile)
    )
    bundle = replace(two_rooms, objects=(*two_rooms.objects, *things))
    for style in STYLES:
        for text in texts_of(EAST, bundle, style=style):
            assert text.isascii() and not set("{}:\n") & set(text) and "ignore" not in text


def test_files_are_instructed_only_where_texts_are_missing(two_rooms, tmp_path):
    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    rng = np.random.default_rng(0)
    episodes = sample_episodes(two_rooms, SampleConfig(count=2), rng).episodes
    episodes.append(replace(episode_of(EAST), instruction="Somebody's own words."))
    result = instruct_episodes(episodes, scenes, InstructConfig(), 1)
    assert result.failed == {}
    assert [e.episode_id for e in result.episodes] == [e.episode_id for e in episodes]
    assert result.episodes[2].instruction == "Somebody's own words."
    for episode in result.episodes[:2]:
        texts = episode.extra["instructions"]
        assert len(set(texts)) == 3 and texts[0] == episode.instruction
        made = episode.extra["instruction"]
        assert made["composer"] == "composer"
        assert [t["text"] for t in made["texts"]] == texts
        assert json.loads(json.dumps(made)) == made
        assert episode.extra["rooms"]  # what the sampler wrote is kept
    write_episodes(tmp_path / "told.json.gz", result.episodes)
    assert str(read_episodes(tmp_path / "told.json.gz")) == str(result.episodes)
    again = instruct_episodes(result.episodes, scenes, InstructConfig(replace=True), 1)
    assert again.episodes[2].instruction != "Somebody's own words."


def test_a_path_without_a_true_text_is_left_out(two_rooms):
    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    result = instruct_episodes(
        [episode_of(EAST)],
        scenes,
        InstructConfig(),
        0,
        writer=lambda ground, rng, rivals: ([], ["the bed is not on the left"]),
    )
    assert result.episodes == []
    assert result.failed == {"e-0": "the bed is not on the left"}


def test_a_shown_path_has_a_title_and_a_legend_of_every_letter_on_its_map(two_rooms):
    facts = facts_of(EAST, two_rooms)
    texts = ["Leave the kitchen.", "Walk past the sofa."]
    episode = replace(episode_of(EAST), extra={"instructions": texts})
    title, *lines = show_path(episode, facts, LevelFacts.of(two_rooms, 0)).splitlines()
    assert title == f"e-0: {facts.length_m:.1f} m, kitchen"
    legend, events, *shown = lines[-2 - len(texts) :]
    assert shown == [f"  - {text}" for text in texts]
    assert "m into living room" in events
    meanings = dict(entry.split(" ", 1) for entry in legend.strip().split(", "))
    assert {"S": "start", "*": "path", "G": "goal"}.items() <= meanings.items()
    assert "sofa" in meanings.values()
    drawn = "\n".join(lines[: -2 - len(texts)])
    assert "kitchen" in drawn and "living room" in drawn
    assert drawn.count("░") > 20  # walls
    for name in ("kitchen", "living room"):
        drawn = drawn.replace(name, "")
    assert set(drawn) - {" ", "\n"} == meanings.keys()
    lines = drawn.splitlines()
    (sofa,) = (letter for letter, noun in meanings.items() if noun == "sofa")
    row = next(line for line in lines if sofa in line)
    start = next(line for line in lines if "S" in line)
    assert row.index(sofa) > start.index("S")  # in the east, where x grows


def test_unknown_names_and_missing_scenes(tmp_path):
    with pytest.raises(UnknownNameError, match="composer"):
        InstructConfig(writer="poet")
    with pytest.raises(UnknownNameError, match="terse"):
        InstructConfig(styles=("baroque",))
    with pytest.raises(InputError, match="1 … 12"):
        InstructConfig(count=0)
    with pytest.raises(InputError, match="English only"):
        InstructConfig(languages=("en", "zh"))
    with pytest.raises(FileFormatError, match="two_rooms"):
        instruct_episodes([episode_of(EAST)], tmp_path, InstructConfig(), 0)


@pytest.mark.parametrize(
    ("category", "plural", "words"),
    [
        ("tv cabinet", False, "TV cabinet"),
        ("chair", True, "chairs"),
        ("bookshelf", True, "bookshelves"),
        ("couch", True, "sofas"),
        ("SofaC_1", False, ""),
    ],
)
def test_names_of_things(category, plural, words):
    assert (spoken(noun_of(category), plural) if noun_of(category) else "") == words


def test_routes_name_rooms(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    (passage,) = facts.passages
    assert (passage.from_room, passage.to_room, passage.doorway) == ("living room", "kitchen", True)
    assert facts.goal_room == "kitchen"
    assert facts.turns[0].side == "left"


def test_facts_follow_their_published_schema(two_rooms):
    from dataclasses import asdict
    from importlib.resources import files

    from pydantic import TypeAdapter

    from vlnpe.instruction_gen.facts.records import PathFacts

    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    published = json.loads((files("vlnpe.instruction_gen.facts") / "facts.schema.json").read_text())
    made = TypeAdapter(PathFacts).json_schema()
    assert {k: v for k, v in published.items() if k != "$schema"} == made | {
        "title": "Facts of one path"
    }
    record = json.loads(json.dumps(asdict(facts_of(LEFT, two_rooms))))
    jsonschema.validate(record, published)


@pytest.mark.parametrize(("behind_m", "room"), [(-0.25, "kitchen"), (0.2, "living room")])
@pytest.mark.parametrize("reverse", [False, True])
def test_the_room_of_an_end_follows_the_door_frame(two_rooms, behind_m, room, reverse):
    """The frame of the door is at x = 4 m."""
    points = [(1.0, 2.0), (4.0 + behind_m, 2.0)]
    facts = facts_of(points[::-1] if reverse else points, two_rooms)
    assert facts.visits[0 if reverse else -1].room == room
    assert len(facts.visits) == (1 if room == "kitchen" else 2)


def test_every_phrase_uses_words_that_the_checker_knows():
    slots = {
        "A": "the kitchen", "B": "the office", "C": "the bedroom", "X": "the sofa",
        "Y": "the table", "Z": "the bed", "s": "left", "t": "right", "n": "four metres",
        "o": "second", "w": "up", "v": "climb", "u": "upstairs", "e": "top",
    }  # fmt: skip
    rng = np.random.default_rng(0)
    for kind, phrases in grammar()[0].items():
        for phrase in phrases:
            for words in {expand(phrase.template, rng) for _ in range(200)}:
                filled = re.sub(r"\{a?(\w+)\}", lambda m: slots.get(m[1], m[1]), words)
                unknown = [t.text for t in tokenize(filled) if not is_known(t.text)]
                assert not unknown, (kind, filled)


def test_texts_of_a_path_speak_of_different_things_and_say_little_twice(two_rooms):
    ground = Ground(facts_of(EAST, two_rooms))
    got, _ = compose_texts(ground, 3, STYLES, np.random.default_rng(2))
    assert [one.style for one in got] == list(STYLES)
    assert len({one.text.split()[0] for one in got}) > 1
    words = [len(one.text.split()) for one in got]
    assert words[1] < words[0] < words[2]


@pytest.mark.parametrize(
    ("before", "goes_on"), [("enter", False), ("turn", False), ("follow", True)]
)
def test_only_a_way_that_is_followed_goes_on_into_a_room(before, goes_on):
    """One may "follow the hallway into the kitchen", not "enter the hallway into" it."""
    rng = np.random.default_rng(0)
    for _ in range(9):
        first = drafts(Event(before, 0.0, B="hallway", s="left"), "natural", rng, 1)[0]
        ways = drafts(Event("enter", 5.0, B="kitchen"), "natural", rng, 40, first)
        assert any(way.phrase.joint == "+" for way in ways) == goes_on


def test_claims_are_kept_beside_the_texts(two_rooms):
    scenes = two_rooms.root.parent
    if not (scenes / "two_rooms").exists():
        (scenes / "two_rooms").symlink_to(two_rooms.root)
    (episode,) = instruct_episodes([episode_of(EAST)], scenes, InstructConfig(), 1).episodes
    ground = Ground(facts_of(EAST, two_rooms))
    for record in episode.extra["instruction"]["texts"]:
        steps = read_steps(json.loads(json.dumps(record["claims"])))
        assert " ".join(step.words for step in steps) == record["text"]
        assert check_text(record["text"], ground, steps).ok
        # Each step begins where those before it are done: what enters the room ends at its door.
        assert record["from_m"][0] == 0.0 and record["from_m"] == sorted(record["from_m"])
        (door,) = ground.facts.passages
        entering = [any(c.kind in ("enter", "door") for c in step.claims) for step in steps]
        after = dict(zip(entering[:-1], record["from_m"][1:], strict=True)).get(True, door.along_m)
        assert after == pytest.approx(door.along_m, abs=0.5)


def test_doorways_of_rooms_of_one_name_are_told_apart(two_rooms):
    """By their side and place in the row."""
    facts = facts_of(LEFT, two_rooms)
    twin = replace(facts.passages[0], alike=1, side="left", ordinal=2, beside="")
    for seed in range(4):
        events = plan(
            replace(facts, passages=(twin,)), TASTES["natural"], np.random.default_rng(seed)
        )
        (told,) = [e for e in events if e.ordinal]
        assert (told.s, told.ordinal) == ("left", 2)


@pytest.mark.parametrize(
    ("doorway", "rooms", "told"), [(True, 1, True), (True, 2, False), (False, 1, False)]
)
def test_a_room_is_told_by_a_thing_that_no_other_room_has(two_rooms, doorway, rooms, told):
    facts = facts_of(EAST, two_rooms)
    (sofa,) = [mark for mark in facts.landmarks if mark.noun == "sofa"]
    shelf = replace(sofa, name="Shelf_1", noun="bookshelf", goal_distance_m=4.0)
    other = replace(shelf, name="Shelf_2", room="kitchen", distance_m=6.0, max_pixels=0)
    doors = tuple(replace(p, doorway=doorway) for p in facts.passages)
    marks = (*facts.landmarks, shelf, other)[: len(facts.landmarks) + rooms]
    facts = replace(facts, landmarks=marks, passages=doors)
    taste = replace(TASTES["rich"], marks=1.0)
    plans = [plan(facts, taste, np.random.default_rng(seed)) for seed in range(40)]
    assert any(e.kind == "enter_by" for events in plans for e in events) == told


def test_a_goal_in_the_doorway_of_another_room_of_the_name_says_so(two_rooms):
    facts = facts_of([(1.0, 2.0), (3.0, 2.0), (4.2, 2.0)], two_rooms)
    (door,) = facts.passages
    visits = tuple(replace(v, room="kitchen", twins=1) for v in facts.visits)
    facts = replace(
        facts, passages=(replace(door, to_room="kitchen"),), visits=visits, goal_rooms=()
    )
    stops = [plan(facts, TASTES["natural"], np.random.default_rng(k))[-1] for k in range(8)]
    assert {stop.kind for stop in stops} >= {"stop_doorway"}
    assert all((stop.B or stop.C).startswith("other ") for stop in stops)


def test_the_longer_texts_of_a_path_go_by_different_plans(two_rooms):
    facts = facts_of(EAST, two_rooms)
    drafts_of = {}
    for style in ("terse", "natural", "rich"):
        rng = np.random.default_rng(0)
        drafts_of[style] = _draft(facts, TASTES[style], rng, Usage(), list(drafts_of.values()))
    terse, natural, rich = (kinds[0] for _, _, kinds, _ in drafts_of.values())
    assert terse == "" and natural != rich and {natural, rich} <= set(PLANS)


def test_one_stops_at_one_thing_and_not_at_a_group(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    table = next(m for m in facts.landmarks if m.noun == "table")
    table = replace(table, goal_distance_m=1.5, goal_open=True)
    for room, clear in ((table.room, False), ("bathroom", True)):
        both = replace(facts, landmarks=(table, replace(table, name="Table_9", room=room)))
        names = Names(both, np.random.default_rng(0), 0.0)
        reference = names.refer(table, 1.0, at_goal=True)
        assert (reference is not None) is clear
        assert reference is None or not reference.plural


def test_what_is_in_view_is_known_where_one_decides(two_rooms):
    facts = facts_of(EAST, two_rooms)
    assert [v.along_m for v in facts.views] == sorted(v.along_m for v in facts.views)
    assert facts.views[0].point == "start" and facts.views[-1].point == "goal"
    (door,) = [v for v in facts.views if v.point == "door"]
    (sofa,) = [s for s in door.things if s.noun == "sofa"]
    assert 1.0 < sofa.distance_m < 4.0 and -80.0 < sofa.bearing_deg < 0.0  # on the right, ahead


def test_a_thing_beside_another_is_known():
    facts = path_facts(episode_of([(2.0, 2.0), (4.0, 2.0)]), building("villa", 5039))
    by_name = {mark.name: mark for mark in facts.landmarks}
    pairs = [(m, by_name[m.beside]) for m in facts.landmarks if m.beside in by_name]
    assert pairs
    assert all(a.noun != b.noun and a.room == b.room for a, b in pairs)
