"""What the composer must not say of a path, though each word of it has a reason."""

from dataclasses import replace

import numpy as np
import pytest

from tests.instruction_gen.test_instruct import EAST, LEFT, facts_of
from vlnpe.instruction_gen.composer.compose import plan
from vlnpe.instruction_gen.composer.names import Names
from vlnpe.instruction_gen.composer.realize import Usage, realize
from vlnpe.instruction_gen.composer.records import TASTES, Event
from vlnpe.instruction_gen.composer.refer import passed
from vlnpe.instruction_gen.composer.stop import stop_events
from vlnpe.instruction_gen.facts.records import TurnFact


def kinds_of(facts, voice="natural"):
    return {e.kind for seed in range(40) for e in plan(facts, TASTES[voice], rng(seed))}


def rng(seed):
    return np.random.default_rng(seed)


def thing(facts, noun):
    return next(mark for mark in facts.landmarks if mark.noun == noun)


def test_what_one_only_sees_is_not_reached_before_the_next_turn(two_rooms):
    facts = facts_of(EAST, two_rooms)
    sofa = Names(facts, rng(0), 0.0).refer(thing(facts, "sofa"), 1.0)
    events = [
        Event("enter_with", 2.0, B="living room", X=sofa, s="right"),
        Event("slight", 2.3, s="left"),
        Event("stop_here", 6.0),
    ]
    for seed in range(60):
        steps, _ = realize(events, "natural", rng(seed), Usage())
        begins = [step.words for step in steps if step.claims[0].degree == "slight"]
        assert not any(words.startswith(("Then", "Next", "After", "From")) for words in begins)


def test_a_hallway_is_not_walked_to_its_end_before_what_lies_in_it(two_rooms):
    facts = facts_of(EAST, two_rooms)
    sofa = Names(facts, rng(0), 0.0).refer(thing(facts, "sofa"), 1.0)
    assert sofa is not None
    events = [Event("follow", 0.2, B="hallway"), Event("pass", 3.0, X=sofa), Event("stop_here", 6)]
    for seed in range(60):
        steps, _ = realize(events, "natural", rng(seed), Usage())
        way = " ".join(step.words for step in steps).split(sofa.phrase)[0]
        assert not {"all", "length", "then"} & set(way.split()), way


@pytest.mark.parametrize(
    ("distance_m", "turn_deg", "is_passed"), [(1.6, 60, False), (1.6, -60, True), (0.7, 60, True)]
)
def test_a_thing_that_only_a_turn_away_from_it_brings_behind_is_not_passed(
    two_rooms, distance_m, turn_deg, is_passed
):
    facts = facts_of(EAST, two_rooms)
    sofa = replace(thing(facts, "sofa"), distance_m=distance_m)
    assert sofa.side == "right"
    facts = replace(facts, turns=(TurnFact(sofa.along_m + 0.2, turn_deg),), landmarks=(sofa,))
    assert passed(sofa, facts, 0.0, facts.length_m) is is_passed


def test_only_the_last_door_is_counted_without_its_room(two_rooms):
    facts = facts_of(LEFT, two_rooms)
    twin = replace(facts.passages[0], alike=1, side="left", ordinal=2, beside="")
    later = replace(twin, along_m=facts.length_m - 0.8, from_room=twin.to_room, to_room="bathroom")
    assert "turn_nth" in kinds_of(replace(facts, passages=(twin,)), "terse")
    last = replace(facts.visits[-1], room="bathroom", from_m=later.along_m)
    facts = replace(facts, passages=(twin, later), visits=(*facts.visits, last))
    assert "turn_nth" not in kinds_of(facts, "terse")


@pytest.mark.parametrize(("before_m", "outside"), [(0.1, True), (0.6, False)])
def test_a_turn_well_before_an_exit_is_not_made_on_leaving(two_rooms, before_m, outside):
    facts = facts_of(LEFT, two_rooms)
    door = replace(facts.passages[0], along_m=2.0)
    turn = TurnFact(door.along_m - before_m, 80.0)
    facts = replace(facts, passages=(door,), turns=(turn,))
    assert ("leave_turn_enter" in kinds_of(facts)) is outside


@pytest.mark.parametrize(
    ("bearing_deg", "kind"), [(-40.0, "stop_before"), (85.0, "stop_outside"), (144.0, "stop_after")]
)
def test_one_stops_outside_a_room_whose_door_is_not_behind(two_rooms, bearing_deg, kind):
    facts = facts_of([(5.0, 0.6), (5.2, 3.4)], two_rooms)
    door = replace(thing(facts, "doorway"), goal_distance_m=1.5, goal_bearing_deg=bearing_deg)
    room = replace(facts.visits[-1], room="hallway", beyond=("kitchen",))
    facts = replace(
        facts, passages=(), visits=(room,), landmarks=(door,), goal_near_rooms=("kitchen",)
    )
    facts = replace(facts, length_m=6.0, turns=(), climbs=())
    stop = stop_events(facts, Names(facts, rng(0), 0.0), TASTES["terse"])[0]
    assert "kitchen" in door.leads
    assert stop.kind == kind


@pytest.mark.parametrize(
    ("turn_deg", "back_deg", "slight"),
    [(-51.0, [24.0], True), (-51.0, [], False), (-80.0, [34.0], False)],
)
def test_a_turn_that_a_bend_right_after_it_undoes_in_part_is_slight(
    two_rooms, turn_deg, back_deg, slight
):
    turns = (TurnFact(3.0, turn_deg), *(TurnFact(4.5, angle) for angle in back_deg))
    facts = replace(facts_of(EAST, two_rooms), passages=(), turns=turns, length_m=9.0)
    assert ("slight" in kinds_of(facts)) is slight
