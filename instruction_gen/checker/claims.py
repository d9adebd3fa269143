"""What each clause of a text claims, in order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..language.clauses import Clause, Parse
from ..language.ending import last_stop
from .claim import Claim, noun_claim, noun_claims
from .ground import Ground, spread
from .hints import elliptic, loose_sides
from .stops import after_stop_claims, stop_claims

_AT_TURN_M = 0.5
_INTO_M = 2.0
# A clause with words that were not understood may say otherwise where things are.
_UNSURE = frozenset(("place", "door", "exit", "walk"))


def claims_of(parse: Parse, ground: Ground) -> list[Claim]:
    """Return the claims of a text."""
    result: list[Claim] = []
    last = last_stop(parse)
    loose = loose_sides(parse)
    for index, clause in enumerate(parse.clauses):
        if clause.negated:
            # Rooms and doors that are not to be entered need not be on the way.
            things = replace(clause, nouns=tuple(n for n in clause.nouns if n.kind == "object"))
            result += [c for c in noun_claims(index, things, ground, "see") if c.kind == "false"]
        elif clause.verb == "stop" or index == last:
            result += stop_claims(index, clause, parse, ground)
        elif last is not None and index > last:
            result += after_stop_claims(index, clause, parse, ground)
        else:
            stated = _moving_claims(index, clause, ground)
            if elliptic(clause, parse):
                stated = [replace(c, maybe=c.kind == "turn") for c in stated]
            if clause.unparsed:
                stated = [replace(c, optional=c.kind in _UNSURE) for c in stated]
            hints = [_hint(index, side, ground) for side in loose[index]]
            result += [*hints, *stated, *(hints if stated else ())]
    return result


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


def _hint(index: int, side: str, ground: Ground) -> Claim:
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    return Claim(index, "turn", everywhere, f"turn {side}", side, "some", maybe=True)


def _turn(index: int, clause: Clause, ground: Ground) -> list[Claim]:
    before: list[Claim] = []
    after: list[Claim] = []
    mask = np.ones(len(ground.along_m), dtype=bool)
    for noun in clause.nouns:
        claim = noun_claim(index, noun, ground, "turn")
        if claim is None:
            continue
        if claim.kind == "false":
            before.append(claim)
        elif noun.prep in ("at", "near", "before", "past", "after", "in", "with", ""):
            mask = mask & spread(claim.mask, ground.along_m, _AT_TURN_M)
        elif noun.prep == "from":
            before.append(claim)
        else:
            if claim.kind == "door":
                # "Turn left into the kitchen": the turn and the door are one place.
                claim = replace(claim, side=claim.side or clause.side, turned=True)
                mask = mask & spread(claim.mask, ground.along_m, _INTO_M)
            after.append(replace(claim, bends=noun.prep == "around" and claim.kind == "place"))
    turn = Claim(index, "turn", mask, f"turn {clause.side}", clause.side, clause.degree)
    walk = []
    if clause.distance_m:
        everywhere = np.ones(len(ground.along_m), dtype=bool)
        walk.append(
            Claim(index, "walk", everywhere, distance_m=clause.distance_m, vague=clause.vague)
        )
    return [*before, turn, *walk, *after]
