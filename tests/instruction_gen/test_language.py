"""The grammar of instructions: idioms, names, sides, and what may be left unsaid."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.instructions.rewording import reworded
from tests.instruction_gen.test_instruct import EAST, LEFT, facts_of
from vlnpe.instruction_gen.checker import check_text
from vlnpe.instruction_gen.checker.hints import loose_sides
from vlnpe.instruction_gen.language.asides import with_asides
from vlnpe.instruction_gen.language.ending import last_stop
from vlnpe.instruction_gen.language.nouns import called
from vlnpe.instruction_gen.language.parse import parse


@pytest.mark.parametrize(
    ("said", "plain"),
    [
        ("Make a turn to the left and stop.", "Turn to the left and stop."),
        ("Turn your body right and stop.", "Turn right and stop."),
        ("Make a U-turn to the right and stop.", "Turn around and stop."),
        ("Circle the table and stop.", "Go around the table and stop."),
        ("Go prior to the sofa and stop.", "Go before the sofa and stop."),
        ("Go straight and stop walking at the sofa.", "Go straight and stop at the sofa."),
        ("Go straight and come to a halt at the sofa.", "Go straight and stop at the sofa."),
        ("Go straight and end up at the sofa.", "Go straight and stop at the sofa."),
        ("Go straight and stay right beside the sofa.", "Go straight and stop beside the sofa."),
        ("Once you've done that, turn left and stop.", "Then turn left and stop."),
        ("Take two rights and stop.", "Turn right then turn right and stop."),
        ("Make two left turns and stop.", "Turn left then turn left and stop."),
        ("Ignoring the sofa, go on and stop.", "Ignore the sofa, go on and stop."),
        ("Go out by the doorway and stop.", "Go out through the doorway and stop."),
        ("Go in at the doorway and stop.", "Go in through the doorway and stop."),
        ("Go up to the sofa, and that's us.", "Go up to the sofa, and stop there."),
        ("Bear right a bit and stop.", "Bear slightly right and stop."),
        (
            "Go past the bed, which you keep on your left, and stop.",
            "Go past the bed, on your left, and stop.",
        ),
    ],
)
def test_idioms_are_read_as_their_plain_words(said, plain):
    def gist(text):
        clauses = parse(text).clauses
        return [(c.verb, c.side, [(n.head, n.prep) for n in c.nouns]) for c in clauses]

    assert gist(said) == gist(plain)


@pytest.mark.parametrize(
    ("text", "asides"),
    [
        ("Go between the counter, left, and the table, right, then stop.", 2),
        ("Between the bench (left) and the rug, then stop.", 1),
        ("Keep on and stop at the rug, sofa just ahead right.", 1),
        ("Past the bed, left, right into the living room, then stop.", 0),
        ("Out of the door, left, past the bench, right, then stop.", 0),
        ("At the fridge turn left, pass the bench and stop at the sofa.", 0),
        ("Follow the table around to the left and stop at the sofa.", 0),
    ],
)
def test_a_side_alone_may_be_that_of_the_thing_before_it(text, asides):
    read = parse(text)
    meant = with_asides(read)
    turns = sum(c.verb == "turn" for c in read.clauses)
    left = sum(c.verb == "turn" for c in meant.clauses) if meant else turns
    assert turns - left == asides


def test_both_readings_of_a_side_alone_are_tried(two_rooms):
    facts = facts_of(EAST, two_rooms)
    text = "Leave the kitchen, go to the sofa, {0}, along the sofa, {0}, and stop past it."
    assert check_text(text.format("right"), facts).ok
    assert not check_text(text.format("left"), facts).ok


def test_who_begins_with_right_has_not_turned_yet(two_rooms):
    facts = facts_of(EAST, two_rooms)
    rest = "off you go out of the kitchen, past the sofa on your right, and stop behind it."
    assert check_text(f"Right, {rest}", facts).ok
    assert not check_text(f"Turn right, {rest}", facts).ok


def test_staying_and_ending_up_are_no_stops_on_the_way():
    verbs = [c.verb for c in parse("End up in the hall, stay left, then stop at the bed.").clauses]
    assert verbs.count("stop") == 1 and verbs[-1] == "stop"


@pytest.mark.parametrize(
    ("noun", "phrase", "right"),
    [
        ("shoe cabinet", "shoe storage cabinet", True),
        ("tv stand", "flat screen stand", True),
        ("wardrobe", "wardrobe closet", True),
        ("dining table", "dining room table", True),
        ("dining table", "pool table", False),
        ("bed", "bunk bed", False),
        ("ceiling lamp", "floor lamp", False),
        ("washing machine", "vending machine", False),
    ],
)
def test_compound_names_mean_things_with_the_same_words(noun, phrase, right):
    assert called(noun, phrase) is right


def test_the_side_before_behind_is_where_a_thing_was():
    passed, there = parse("Stop once the sofa on your left is behind you.").clauses[-1].nouns
    assert (passed.prep, passed.side, there.side) == ("past", "left", "behind")


def test_a_turn_to_the_only_door_of_the_first_room_need_not_be_stated(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    text = "Leave the living room, enter the kitchen and stop just inside."
    assert facts.visits[0].room == "living room" and facts.turns
    first = facts.visits[0]
    for beyond, ok in (
        (("kitchen",), True),
        (("kitchen", "kitchen"), False),
        (("bedroom", "kitchen"), True),  # one opening leads into the room that is named
    ):
        start = replace(first, exits=len(beyond), beyond=beyond)
        changed = replace(facts, visits=(start, *facts.visits[1:]))
        assert check_text(text, changed).ok is ok
    nowhere = text.replace("enter the kitchen", "go through the doorway")
    start = replace(first, exits=2, beyond=("bedroom", "kitchen"))
    assert not check_text(nowhere, replace(facts, visits=(start, *facts.visits[1:]))).ok


@pytest.mark.parametrize(
    ("text", "stop"),
    [
        ("Turn left into the kitchen and go past the sofa to the table.", 1),
        ("Turn left into the kitchen and walk two metres towards the table.", 1),
        ("Turn left and walk to the door of the kitchen. Do not go in.", 1),
        ("Turn left into the kitchen. You should be next to the table.", 1),
        ("Turn left into the kitchen. Walk up to the table. That's it.", 2),
        ("Turn left and walk down the hallway to the kitchen.", None),
        ("Turn left into the kitchen and go past the table.", None),
    ],
)
def test_a_text_may_end_with_where_to_go_or_how_far(text, stop):
    assert last_stop(parse(text)) == stop


def test_what_must_not_be_done_is_negated_to_its_end():
    read = parse("In the hall don't go left to the kitchen. Ignore the sofa and the bed, and stop.")
    assert [c.negated for c in read.clauses] == [True, True, False]
    read = parse("Take the left door, not the right one, which leads to the kitchen, and stop.")
    assert [c.negated for c in read.clauses] == [False, True, True, False]


@pytest.mark.parametrize(
    ("text", "noun", "side"),
    [
        ("Stop with the table at nine o'clock.", "table", "left"),
        ("Stop with the table at your two o'clock.", "table", "right"),
        ("Stop once the table's on your left.", "table", "left"),
        ("Stop there; the table is then on your left.", "table", "left"),
        ("Keep the sofa right and the table left, and stop.", "sofa", "right"),
        ("Keep the sofa right and the table left, and stop.", "table", "left"),
        ("Go around the left of the table and stop.", "table", "right"),
    ],
)
def test_sides_are_read_where_people_say_them(text, noun, side):
    nouns = [n for c in parse(text).clauses for n in c.nouns]
    assert (noun, side) in [(n.head, n.side) for n in nouns]


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("Walk another metre and a half.", 1.5),
        ("Walk three and a half metres.", 3.5),
        ("Stop a metre and a half before the bed.", 0.0),
        ("Turn 45 degrees left.", 0.0),
        ("Make two small steps.", 1.4),
    ],
)
def test_only_how_far_to_walk_is_a_distance(text, metres):
    assert max(c.distance_m for c in parse(text).clauses) == metres


def test_the_end_of_a_thing_is_no_stop():
    read = parse("Walk a metre past where the rug ends, to the end of the hallway, and turn left.")
    assert all(c.verb != "stop" for c in read.clauses)


@pytest.mark.parametrize("ends", ["it finishes", "the sideboard is finished", "the rug ends"])
def test_the_end_of_a_thing_on_the_way_is_no_stop(ends):
    clauses = parse(f"Go past the table until {ends}, then turn left and stop.").clauses
    assert [c.verb for c in clauses].count("stop") == 1


def test_what_is_said_after_until_when_to_walk_ends_a_text():
    assert last_stop(parse("Go on to the end, and where a mirror is on your right, hooray.")) == 1
    assert last_stop(parse("Go down the hall. When the room is on your right, you can.")) is None


def test_rooms_beside_the_goal_may_be_named(two_rooms):
    facts = facts_of(EAST[::-1], two_rooms)
    text = "Go straight past the sofa and wait outside the kitchen."
    near = replace(facts, visits=facts.visits[:1], passages=(), goal_near_rooms=("kitchen",))
    assert check_text(text, near).ok
    assert not check_text(text, replace(near, goal_near_rooms=())).ok


def test_reworded_true_texts_stay_true(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    text = "Turn left into the kitchen, then stop next to the table."
    rng = np.random.default_rng(0)
    texts = {reworded(text, rng) for _ in range(40)}
    assert len(texts) > 15
    assert not [t for t in texts if not check_text(t, facts).ok]


@pytest.mark.parametrize(
    "text",
    [
        "Turn left into the kitchen, mosey through the gap, and stop next to the table.",
        "Whizz round to the left into the kitchen, then stop next to the table.",
        "Turn left into the kitchen and plonk yourself next to the table.",
        "Turn left into the kitchen and stop moving next to the table.",
    ],
)
def test_words_that_are_not_known_claim_nothing(two_rooms, text):
    assert check_text(text, facts_of(LEFT, two_rooms)).problems == ()


@pytest.mark.parametrize(
    "text",
    [
        "Turn left into the kitchen past the harpsichord, then stop next to the table.",
        "Whizz round to the right into the kitchen, then stop next to the table.",
        "Turn left into the kitchen and walk between the table and the wall.",
        "Turn left into the kitchen, stop next to the table and go through the doorway.",
    ],
)
def test_what_is_understood_and_false_is_refused_among_unknown_words(two_rooms, text):
    assert not check_text(text, facts_of(LEFT, two_rooms)).ok


def test_a_side_that_is_bound_to_a_thing_is_no_hint_of_a_turn():
    bound = parse("Whizz past the sofa on your left and stop at the bed.")
    loose = parse("Whizz round it to the left past the sofa and stop at the bed.")
    assert loose_sides(bound)[0] == ()
    pairs = zip(loose.clauses, loose_sides(loose), strict=True)
    assert any("left" in (*sides, clause.side) for clause, sides in pairs)


def test_a_half_turn_is_a_slight_one():
    (turn, *_) = parse("Half left, then stop at the chair.").clauses
    assert (turn.side, turn.degree) == ("left", "slight")


def test_the_side_of_it_is_no_hint_of_a_turn():
    assert loose_sides(parse("Go round it with it on your left, and stop at the bed."))[0] == ()
    assert loose_sides(parse("You are right at the bed."))[0] == ()


@pytest.mark.parametrize(
    "text",
    [
        "Living room, kitchen: turn left into the kitchen and stop next to the table.",
        "You want the kitchen: turn left, go through the doorway and stop next to the table.",
        "Cross the living room diagonally through the doorway into the kitchen, then stop next to "
        "the table.",
        "Take the first doorway on the left into the kitchen and stop next to the table.",
    ],
)
def test_what_people_say_beside_the_way_is_true(two_rooms, text):
    assert check_text(text, facts_of(LEFT, two_rooms)).problems == ()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("Living room, bathroom: turn left into the kitchen, stop next to the table.", "bathroom"),
        ("You want the bathroom: turn left and stop next to the table.", "bathroom"),
        ("Take the third doorway on the left into the kitchen and stop next to the table.", "3"),
        ("Cross the living room diagonally past the piano, turn left and stop next to the table.",
         "piano"),
        ("Take two lefts into the kitchen and stop next to the table.", "does not turn left"),
    ],
)  # fmt: skip
def test_what_people_say_beside_the_way_may_be_false(two_rooms, text, complaint):
    assert complaint in " ".join(check_text(text, facts_of(LEFT, two_rooms)).problems)


def test_through_the_other_doorway_of_a_room_leads_around_a_bend(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    (turn,) = [t for t in facts.turns if abs(t.angle_deg) > 58]
    start, end = facts.visits
    # The same path with a room before it: the bend lies in a room that is passed through.
    middle = replace(start, from_m=0.5, exits=2, beyond=())
    before = replace(start, room="hallway", to_m=0.5, exits=3)
    through = replace(facts, visits=(before, middle, end))
    text = "Go past the sofa, out through the other doorway, and stop in the kitchen."
    assert turn.along_m > middle.from_m
    assert check_text(text, through).ok
    several = replace(through, visits=(before, replace(middle, exits=4), end))
    assert not check_text(text, several).ok
