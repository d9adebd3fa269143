"""What each clause of a text claims, in order."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..language.clauses import Clause, Parse
from ..language.ending import destination, goal_index, last_stop
from .claim import Claim, noun_claim, noun_claims
from .ground import Ground, spread
from .hints import elliptic, loose_sides
from .stops import after_stop_claims, stop_claims

# Who goes straight to a thing makes no turn on the way.
_STRAIGHT = re.compile(r"\bstraight\b(?! away)", re.IGNORECASE)
# Who crosses a room diagonally leaves the line that he came in on, to a side that is not told.
_DIAGONAL = re.compile(r"\bdiagonal|\bat an angle\b", re.IGNORECASE)
# "Kitchen, hall, bathroom: through the …": the way at a glance.
_OVERVIEW = re.compile(r"[^.:;!]*:")
_AND = re.compile(r"\band\s*$", re.IGNORECASE)
_AT_TURN_M = 0.5
_INTO_M = 2.0
_INSIDE_M = 4.0
# A clause with words that were not understood may say otherwise where things are.
_UNSURE = frozenset(("place", "door", "exit", "walk"))


def claims_of(parse: Parse, ground: Ground) -> list[Claim]:
    """Return the claims of a text."""
    result: list[Claim] = []
    last = last_stop(parse)
    loose = loose_sides(parse)
    overview = _overview(parse)
    for index, clause in enumerate(parse.clauses):
        if index < overview:
            seen = [noun_claim(index, n, ground, "see") for n in clause.nouns]
            result += [c for c in seen if c is not None and c.kind == "false"]
            continue
        if clause.negated:
            # Rooms and doors that are not to be entered need not be on the way.
            things = replace(clause, nouns=tuple(n for n in clause.nouns if n.kind == "object"))
            result += [c for c in noun_claims(index, things, ground, "see") if c.kind == "false"]
        elif index == last and destination(clause, parse):
            # "Past the bed to the window.": the last noun alone says where it ends.
            k = goal_index(clause)
            result += _moving_claims(index, replace(clause, nouns=clause.nouns[:k]), ground)
            end = replace(clause, verb="stop", side="", distance_m=0.0, nouns=clause.nouns[k:])
            result += stop_claims(index, end, parse, ground)
        elif clause.verb == "stop" or index == last:
            result += stop_claims(index, clause, parse, ground)
        elif last is not None and index > last:
            result += after_stop_claims(index, clause, parse, ground)
        else:
            before = parse.clauses[:index]
            joined = bool(before) and _AND.search(parse.text[: clause.start]) is not None
            stated = _moving_claims(index, _listed(clause, before, joined=joined), ground)
            if before and not clause.verb and _leaves(before[-1]):
                # "Out of the bedroom, past the bed": what is passed may lie before the door.
                stated = [replace(c, slack_m=max(c.slack_m, _INSIDE_M)) for c in stated]
            if elliptic(clause, parse):
                stated = [replace(c, maybe=c.kind == "turn") for c in stated]
            if clause.unparsed:
                stated = [replace(c, optional=c.kind in _UNSURE) for c in stated]
            if _DIAGONAL.search(_said(clause, parse)):
                result += [_hint(index, side, ground) for side in ("left", "right")]
            hints = [_hint(index, side, ground) for side in loose[index]]
            result += [*hints, *stated, *(hints if stated else ())]
    straight = {k for k, c in enumerate(parse.clauses) if _STRAIGHT.search(_said(c, parse))}
    return [
        replace(c, rooms=frozenset(), view=None) if c.clause in straight else c
        for c in _leading(result)
    ]


def _overview(parse: Parse) -> int:
    """Return how many clauses at the beginning only list the rooms of the way."""
    found = _OVERVIEW.match(parse.text)
    listed = [c for c in parse.clauses if found and c.stop <= found.end()]
    bare = all(not (c.verb or c.side or c.distance_m) and c.nouns for c in listed)
    rooms = all(n.kind == "room" and not n.prep for c in listed for n in c.nouns)
    return len(listed) if len(listed) > 1 and bare and rooms else 0


def _said(clause: Clause, parse: Parse) -> str:
    return parse.text[clause.start : clause.stop]


def _leading(claims: list[Claim]) -> list[Claim]:
    """Return the claims; leaving a room leads into the room that is named next."""
    result: list[Claim] = []
    rooms: frozenset[str] = frozenset()
    for claim in reversed(claims):
        rooms = claim.rooms or rooms
        nameless = claim.kind == "exit" or (claim.kind == "door" and not claim.rooms)
        result.append(replace(claim, rooms=rooms) if nameless else claim)
    return result[::-1]


def _listed(clause: Clause, before: Sequence[Clause], *, joined: bool) -> Clause:
    """Return the clause; in `pass the bench, then a doorway on the left` one passes both."""
    goes_on = bool(before) and before[-1].verb in ("pass", "see") and not before[-1].until
    named = bool(clause.nouns) and not any(n.prep or n.ordinal for n in clause.nouns)
    if not named or clause.verb or clause.side or clause.until:
        return clause
    if goes_on:
        return replace(clause, verb=before[-1].verb)
    # "Past the bench on the left and the door on the right"
    if joined and before and before[-1].nouns[-1:] and before[-1].nouns[-1].prep == "past":
        return replace(clause, nouns=tuple(replace(n, prep="past") for n in clause.nouns))
    return clause


def _moving_claims(index: int, clause: Clause, ground: Ground) -> list[Claim]:
    if clause.verb == "turn" or clause.side:
        return _turn(index, clause, ground)
    result = []
    if clause.distance_m:
        everywhere = np.ones(len(ground.along_m), dtype=bool)
        result.append(
            Claim(
                index,
                "walk",
                everywhere,
                f"walk {clause.distance_m:.1f} m",
                distance_m=clause.distance_m,
                vague=clause.vague,
            )
        )
    # "Turn left before you reach the bed": it lies ahead and need not be reached.
    return result + noun_claims(index, clause, ground, "see" if clause.before else clause.verb)


def _leaves(clause: Clause) -> bool:
    return clause.verb == "leave" or any(n.prep == "from" for n in clause.nouns)


def _hint(index: int, side: str, ground: Ground) -> Claim:
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    return Claim(index, "turn", everywhere, f"turn {side}", side, "some", maybe=True)


def _turn(index: int, clause: Clause, ground: Ground) -> list[Claim]:
    before: list[Claim] = []
    after: list[Claim] = []
    mask = np.ones(len(ground.along_m), dtype=bool)
    rooms: frozenset[str] = frozenset()
    beyond = False  # what is named after "left through the living room" does not say where to turn
    for noun in clause.nouns:
        claim = noun_claim(index, noun, ground, "turn")
        if claim is None:
            continue
        if claim.kind == "false":
            before.append(claim)
        elif beyond:
            after.append(claim)
        elif noun.prep in ("at", "near", "before", "past", "after", "in", "with", ""):
            mask = mask & spread(claim.mask, ground.along_m, _AT_TURN_M)
        elif noun.prep == "from":
            before.append(claim)
        else:
            if claim.kind == "door":
                # "Turn left into the kitchen": the turn and the door are one place.
                claim = replace(claim, side=claim.side or clause.side, turned=True)
                mask = mask & spread(claim.mask, ground.along_m, _INTO_M)
                rooms = rooms or claim.rooms
            after.append(replace(claim, bends=noun.prep == "around" and claim.kind == "place"))
            beyond = noun.kind == "room" and noun.prep in ("through", "along")
    # "Until you face the door", "turn in there": whether one turns, and where to, is not told.
    sided = bool(clause.side)
    turn = Claim(
        index, "turn", mask, f"turn {clause.side}", clause.side, clause.degree if sided else "some",
        rooms=rooms, maybe=not sided,
    )  # fmt: skip
    walk = []
    if clause.distance_m:
        everywhere = np.ones(len(ground.along_m), dtype=bool)
        walk.append(
            Claim(index, "walk", everywhere, distance_m=clause.distance_m, vague=clause.vague)
        )
    return [*before, turn, *walk, *after]
