"""The grammar of instructions: idioms, names, sides, and what may be left unsaid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.instructions.rewording import reworded
from tests.instruction_gen.test_instruct import EAST, LEFT, facts_of
from vlnpe.instruction_gen.checker import check_text
from vlnpe.instruction_gen.checker.hints import loose_sides
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
    ],
)
def test_idioms_are_read_as_their_plain_words(said, plain):
    def gist(text):
        clauses = parse(text).clauses
        return [(c.verb, c.side, [(n.head, n.prep) for n in c.nouns]) for c in clauses]

    assert gist(said) == gist(plain)


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
    text = "Leave the living room, enter the kitchen and stop next to the table."
    assert facts.visits[0].room == "living room" and facts.turns
    first = facts.visits[0]
    for exits, ok in ((1, True), (2, False)):
        changed = replace(facts, visits=(replace(first, exits=exits), *facts.visits[1:]))
        assert check_text(text, changed).ok is ok


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
