"""True claims about generated paths hold, and each false change of one claim is refused."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.instructions.buildings import building
from benchmarks.instructions.corpus import FOLDER, episode_of_record
from vlnpe.instruction_gen.checker import Ground, check_text
from vlnpe.instruction_gen.checker.order import LIMIT, Alignment, check_order
from vlnpe.instruction_gen.composer import compose_texts
from vlnpe.instruction_gen.facts import path_facts
from vlnpe.instruction_gen.facts.doors import DOOR, OPENING
from vlnpe.instruction_gen.language.claims import Claim, Step
from vlnpe.instruction_gen.language.nouns import called

OTHER = {"left": "right", "right": "left"}


@pytest.fixture(scope="module")
def grounds():
    """The paths of a generated villa and a generated apartment."""
    result = []
    for kind, seed in (("villa", 43), ("apartment", 9101)):
        document = json.loads((FOLDER / f"{kind}-{seed}.json").read_text())
        level = building(kind, seed)
        episodes = [episode_of_record(p, f"{kind}-{seed}") for p in document["paths"]]
        result += [Ground(path_facts(e, level)) for e in episodes if e.level == 0]
    return result


def told(ground):
    """Return what happens along a path, as claims, with where [m]."""
    facts = ground.facts
    turns = [(t.along_m, Claim("turn", side=t.side)) for t in facts.turns
             if abs(t.angle_deg) >= 50.0 and t.along_m < facts.length_m - 0.9]  # fmt: skip
    rooms = [(p.along_m, Claim("enter", "room", p.to_room)) for p in facts.passages if p.to_room]
    stop = (facts.length_m, Claim("stop", "room", facts.goal_room, place="inside"))
    return [*sorted(turns + rooms, key=lambda event: event[0]), stop]


def changed(claims, k, **new):
    return [*claims[:k], replace(claims[k], **new), *claims[k + 1 :]]


def turn_sides(claims, at_m, ground):
    """No bend to the other side is near."""
    near = [[t for t in ground.facts.turns if abs(t.along_m - at) < 2.5] for at in at_m]
    return [
        changed(claims, k, side=OTHER[c.side])
        for k, c in enumerate(claims)
        if c.kind == "turn" and c.side in OTHER and all(t.side == c.side for t in near[k])
    ]


def door_sides(claims, at_m, ground):
    doors = {p.along_m: p.side for p in ground.facts.passages}
    return [changed(claims, k, side=OTHER[doors[at_m[k]]]) for k, c in enumerate(claims)
            if c.kind == "enter" and doors[at_m[k]]]  # fmt: skip


def rooms(claims, at_m, ground):
    facts = ground.facts
    own = {v.room for v in facts.visits} | {*facts.start_rooms, *facts.goal_rooms}
    others = [r for r in facts.level_rooms if not ground.rooms(r) & own]
    return [changed(claims, k, name=other) for k, c in enumerate(claims) if c.what == "room"
            for other in others]  # fmt: skip


def rooms_in_another_order(claims, at_m, ground):
    enters = [k for k, c in enumerate(claims) if c.kind == "enter"]
    return [changed(changed(claims, a, name=claims[b].name), b, name=claims[a].name)
            for a, b in pairwise(enters)
            if at_m[b] - at_m[a] > 2.0]  # fmt: skip


def left_out_turns(claims, at_m, ground):
    """The way is straight on past the only turn to its side."""
    clear = {t.along_m for t in ground.facts.turns if abs(t.angle_deg) > 70.0 and t.along_m > 0.5}
    sides = [c.side for c in claims if c.kind == "turn"]
    return [
        [*claims[:k], Claim("walk", side="ahead"), *claims[k + 1 :]]
        for k, c in enumerate(claims)
        if c.kind == "turn" and at_m[k] in clear and sides.count(c.side) == 1
    ]


def early_stops(claims, at_m, ground):
    return [[*claims[: k + 1], Claim("stop")] for k, along in enumerate(at_m)
            if ground.length_m - along > 4.0 and claims[k].kind == "enter"]  # fmt: skip


def early_distances(claims, at_m, ground):
    """Doubled and halved distances to the first turn or room."""
    metres = round(at_m[0], 1)
    result = [[Claim("walk", metres=f * metres), *claims] for f in (0.5, 2.0)]
    bent = any(t.along_m < at_m[0] for t in ground.facts.turns)
    return result if metres >= 3.0 and not bent else []


def ordinals(claims, at_m, ground):
    places = {p.along_m: p for p in ground.facts.passages if p.doorway and p.ordinal}
    return [[*claims[:k], Claim("door", "door", side=p.side, ordinal=p.ordinal + 2), *claims[k:]]
            for k, along in enumerate(at_m) if (p := places.get(along))]  # fmt: skip


def things(claims, at_m, ground):
    absent = [n for n in ("piano", "aquarium") if n not in ground.facts.level_nouns]
    return [[*claims[:-1], Claim(kind, "thing", noun), claims[-1]]
            for kind in ("pass", "see", "reach", "stop") for noun in absent]  # fmt: skip


def rooms_passed(claims, at_m, ground):
    """Rooms to which no opening within four metres of the path leads."""
    marks = [m for m in ground.facts.landmarks if m.noun in (DOOR, OPENING) and m.distance_m < 4.0]
    near = {room for m in marks for room in m.leads} | {v.room for v in ground.facts.visits}
    return [[*claims[:-1], Claim("pass", "room", room), claims[-1]]
            for room in ground.facts.level_rooms if not ground.rooms(room) & near]  # fmt: skip


CHANGES = [turn_sides, door_sides, rooms, rooms_in_another_order, left_out_turns, early_stops,
           early_distances, ordinals, things, rooms_passed]  # fmt: skip


def problems(claims, ground):
    return [p.reason for p in check_order(claims, list(range(len(claims))), ground)]


def test_what_happens_along_a_path_is_true(grounds):
    for ground in grounds:
        claims = [claim for _, claim in told(ground)]
        assert problems(claims, ground) == [], ground.facts.trajectory_id


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_a_false_claim_is_refused(grounds, change):
    tried, passed = 0, []
    for ground in grounds:
        at_m, claims = zip(*told(ground), strict=True)
        for false in change(list(claims), at_m, ground):
            tried += 1
            if not problems(false, ground):
                passed.append((ground.facts.trajectory_id, false))
    assert tried
    assert not passed


def test_things_are_beside_the_path_on_one_side_only(grounds):
    checked = 0
    for ground in grounds:
        for n, mark in enumerate(ground.facts.landmarks):
            alone = sum(called(m.noun, mark.noun) for m in ground.facts.landmarks) == 1
            beside = (ground.near_m[n] <= 1.5) & (abs(abs(ground.facing[n]) - 90.0) < 35.0)
            one_way = abs(ground.facing[n][ground.near_m[n] <= 4.0]) > 20.0
            if mark.leads or not alone or not mark.side or not beside.any() or not one_way.all():
                continue
            checked += 1
            for side in ("left", "right"):
                claim = Claim("pass", "thing", mark.noun, side=side)
                told = (ground.facts.trajectory_id, mark.noun, side)
                own = side == mark.side
                # What is behind at the start is not passed.
                if not own or np.isinf(ground.distance[n, 0]) or abs(ground.bearing[n, 0]) < 90.0:
                    cost = ground.passed(claim).cost.min()
                    assert cost <= LIMIT if own else cost > 1.0, told
    assert checked > 5


def test_words_say_what_claims_leave_open(grounds):
    """Straight on is checked although the claims say only that one walks."""
    for ground in grounds:
        turn = next(
            (t for t in ground.facts.turns if abs(t.angle_deg) > 75 and t.along_m > 2), None
        )
        if turn is None or turn.along_m > ground.length_m - 2.0:
            continue
        text = "Walk straight on to the end and stop."
        steps = [Step(text, (Claim("walk"), Claim("stop")))]
        assert not check_text(text, ground, steps).ok


def test_what_a_claim_adds_to_the_cost_is_told(grounds):
    """A refusal names what is wrong, also where a claim does not move the walker."""
    dear = 0
    for ground in grounds:
        without = Alignment(ground, [Claim("walk"), Claim("stop")], [0, 1]).cost
        for mark in ground.facts.landmarks:
            claims = [Claim("see", "thing", mark.noun), Claim("walk"), Claim("stop")]
            placed = Alignment(ground, claims, [0, 1, 2])
            added = np.sqrt(max(0.0, placed.cost**2 - without**2))
            dear += added > LIMIT
            told = np.linalg.norm([cost for cost, _ in placed.told[0]])
            assert told >= 0.95 * added, (mark.noun, added, placed.told[0])
    assert dear > 5


@pytest.mark.parametrize(("words", "goal", "holds"), [
    ("Your destination is the {}.", True, True),
    ("Your destination is the {}.", False, False),
    ("Stop in the {}.", True, False),
])  # fmt: skip
def test_a_text_may_say_first_where_the_way_ends(grounds, words, goal, holds):
    tried = 0
    for ground in grounds:
        facts = ground.facts
        own = {v.room for v in facts.visits} | {*facts.start_rooms, *facts.goal_rooms}
        other = [r for r in facts.level_rooms if not ground.rooms(r) & own]
        texts, _ = compose_texts(ground, 1, ("terse",), np.random.default_rng(0))
        room = facts.goal_room if goal else other[0] if other else ""
        if not (room and texts) or len(facts.visits) < 2 or facts.visits[0].room == facts.goal_room:
            continue
        claim = Claim("stop", "room", room, place="inside")
        steps = (Step(words.format(room), (claim,)), *texts[0].steps)
        verdict = check_text(" ".join(step.words for step in steps), ground, steps)
        assert verdict.ok is holds, (verdict.problems, steps)
        assert verdict.steps[0].claims == (claim,)
        tried += 1
    assert tried > 3
