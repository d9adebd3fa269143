"""How strongly a text contradicts the facts, and which of its readings counts."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.instructions.buildings import building
from tests.instruction_gen.test_instruct import EAST, LEFT, facts_of
from vlnpe.formats.scene.bundle import LabeledObject
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.checker.align import align
from vlnpe.instruction_gen.checker.claims import claims_of
from vlnpe.instruction_gen.language.announced import announcement
from vlnpe.instruction_gen.language.parse import parse


def strength(text, facts):
    """Return how strongly a text is contradicted, read as it stands."""
    ground = Ground(facts)
    return sum(one.strength for one in align(claims_of(parse(text), ground), ground))


def test_a_bend_that_the_facts_lack_is_a_weak_contradiction(two_rooms):
    facts = facts_of(EAST, two_rooms)
    rest = "and go on past the sofa, then stop when the sofa is behind you."
    assert not facts.turns
    assert 0 < strength(f"Leave the kitchen, bear right {rest}", facts) < 1
    assert strength(f"Leave the kitchen, turn right {rest}", facts) >= 1
    assert check_text(f"Leave the kitchen, bear right {rest}", facts).ok
    assert not check_text(f"Leave the kitchen, turn right {rest}", facts).ok


def test_weak_contradictions_add_up(two_rooms):
    facts = facts_of(EAST, two_rooms)
    text = "Leave the kitchen, {}go on past the sofa, then stop when the sofa is behind you."
    assert check_text(text.format("bear right, "), facts).ok
    assert not check_text(text.format("bear right, veer left, "), facts).ok


@pytest.mark.parametrize(
    "first",
    [
        "In the kitchen, right by the table, is where you stop.",
        "This one finishes just inside the kitchen, beside the table.",
        "The place to reach is the table in the kitchen.",
        "Get yourself to the table.",
    ],
)
def test_a_first_sentence_that_moves_nowhere_may_be_the_goal(two_rooms, first):
    facts = facts_of(LEFT, two_rooms)
    way = "Turn left and go through the doorway."
    assert announcement(parse(f"{first} {way}"))[0]
    assert check_text(f"{first} {way}", facts).ok
    assert not check_text(f"{first} {way.replace('left', 'right')}", facts).ok
    assert not check_text(f"{first.replace('table', 'sofa')} {way}", facts).ok


def test_a_building_made_without_a_scan_has_rooms_that_doors_join():
    level = building("apartment", 3)
    assert "doorway" in level.nouns and "bathroom" in level.names
    assert all(any(openings) for openings in level.openings)
    inside = np.unique(level.regions.region)
    assert set(inside[inside >= 0]) == set(range(len(level.names)))


@pytest.mark.parametrize(
    "text",
    [
        "Leave the kitchen, pass the {}, then stop when the sofa is behind you.",
        "Leave the kitchen and go past the {}, then stop when the sofa is behind you.",
        "Leave the kitchen and stop just past the sofa, by the {}.",
    ],
)
def test_what_one_passes_or_stops_at_must_be_there_whatever_it_is_called(two_rooms, text):
    facts = facts_of(EAST, two_rooms)
    for noun in ("humidor", "spittoon", "old brass astrolabe"):
        problems = check_text(text.format(noun), facts).problems
        assert any("nothing here is called" in p and noun.split()[-1] in p for p in problems)


def test_an_unknown_word_elsewhere_claims_nothing(two_rooms):
    facts = facts_of(EAST, two_rooms)
    text = (
        "Leave the kitchen with its humidor feel, go past the sofa and stop when it is behind you."
    )
    assert check_text(text, facts).ok


def with_armchairs(bundle, *centres):
    chairs = [
        LabeledObject(
            f"armchair_{k}", "armchair", (x - 0.3, y - 0.3, 0.0), (x + 0.3, y + 0.3, 1.0), 0
        )
        for k, (x, y) in enumerate(centres)
    ]
    return replace(bundle, objects=(*bundle.objects, *chairs))


def test_a_thing_with_a_side_is_counted_among_all_or_among_those_on_that_side(two_rooms):
    facts = facts_of(EAST, with_armchairs(two_rooms, (4.6, 1.0), (5.6, 2.8)))
    text = "Leave the kitchen and pass the {} armchair on your {}, then stop past the sofa."
    for number in ("first", "second"):
        assert check_text(text.format(number, "left"), facts).ok
    assert check_text(text.format("first", "right"), facts).ok
    assert not check_text(text.format("second", "right"), facts).ok
    assert not check_text(text.format("third", "left"), facts).ok
