"""What each clause of a text claims, in order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..language.clauses import Clause, Noun, Parse
from .ground import Found, Ground, Mask, spread


@dataclass(frozen=True)
class Claim:
    """One thing that must hold, after what was claimed before it.

    Attributes:
        clause: index of its clause.
        kind: `place`, `door` (going through), `exit`, `turn`, `walk`, `stop` or `false`.
        mask: (S,) where it holds.
        reason: of a false claim, or what the claim says.
        side: of a turn.
        degree: of a turn.
        distance_m: of a walk [m].
        vague: a distance of `a few`.
        slack_m: how far it may lie before the claim before it [m].
        bare: a stop that names no place.
        still: it is seen or passed meanwhile and moves nobody on.
        bends: a path around a thing, which tells the turns made there.
        turned: a door whose clear turn the same clause tells.
        abeam_m: where a thing that is passed once is beside the walker [m], None = unclear.
    """

    clause: int
    kind: str
    mask: Mask
    reason: str = ""
    side: str = ""
    degree: str = ""
    distance_m: float = 0.0
    vague: bool = False
    slack_m: float = 1.2
    bare: bool = False
    still: bool = False
    bends: bool = False
    turned: bool = False
    abeam_m: float | None = None


_AT_TURN_M = 0.8
_INTO_M = 2.0
MOVING = frozenset({"turn", "move", "enter", "leave", "pass"})


def claims_of(parse: Parse, ground: Ground) -> list[Claim]:
    """The claims of a text."""
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    result: list[Claim] = []
    last = last_stop(parse)
    for index, clause in enumerate(parse.clauses):
        if clause.negated:
            result += [c for c in _nouns(index, clause, ground, "see") if c.kind == "false"]
        elif clause.verb == "stop" or index == last:
            result += _stop(index, clause, parse, ground)
        elif last is not None and index > last:
            result += _after_stop(index, clause, ground)
        elif clause.verb == "turn" or clause.side:
            result += _turn(index, clause, ground)
        else:
            if clause.distance_m:
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
            result += _nouns(index, clause, ground, "see" if clause.before else clause.verb)
    return result


def last_stop(parse: Parse) -> int | None:
    """Index of the clause that says where to stop, None when no clause does.

    `Walk on until you are next to the bed.` needs no word for stopping at the end of a text.
    """
    stops = [k for k, c in enumerate(parse.clauses) if c.verb == "stop" and not c.negated]
    if stops:
        return stops[-1]
    last = parse.clauses[-1] if parse.clauses else None
    if last is None or not last.until or last.before or last.negated:
        return None
    arrives = last.verb in ("pass", "reach", "enter") or any(n.prep or n.side for n in last.nouns)
    return len(parse.clauses) - 1 if last.nouns and arrives else None


def _turn(index: int, clause: Clause, ground: Ground) -> list[Claim]:
    before: list[Claim] = []
    after: list[Claim] = []
    mask = np.ones(len(ground.along_m), dtype=bool)
    for noun in clause.nouns:
        claim = _noun(index, noun, ground, "turn")
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


def _stop(index: int, clause: Clause, parse: Parse, ground: Ground) -> list[Claim]:
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    result: list[Claim] = []
    if clause.distance_m:
        result.append(
            Claim(index, "walk", everywhere, distance_m=clause.distance_m, vague=clause.vague)
        )
    mask = ground.at_goal()
    named = bool(clause.distance_m)
    for noun in clause.nouns:
        found = _stop_noun(noun, ground)
        if found is None:
            continue
        named = True
        if found.reason:
            result.append(Claim(index, "false", everywhere, found.reason))
        else:
            mask = mask & found.mask
    # "Stop when you reach the bed": what comes next says where.
    nexts = parse.clauses[index + 1 : index + 2]
    named = named or any(c.until or c.verb in ("see", "reach", "") for c in nexts)
    result.append(Claim(index, "stop", mask, "stop", bare=not named, slack_m=2.4))
    return result


def _stop_noun(noun: Noun, ground: Ground) -> Found | None:
    if noun.kind == "object" and noun.prep in ("after", "past"):
        return ground.stopped_after(noun)
    if noun.kind == "object":
        return ground.stopped_at(noun)
    if noun.kind == "room":
        if noun.part in ("entrance", "threshold", "mouth") or noun.prep in ("before", "at"):
            near = ground.entered(noun)
            near_goal = near.mask & ground.at_goal(2.6)
            return Found(ground.at_goal()) if near_goal.any() else ground.stopped_in(noun)
        return ground.stopped_in(noun)
    if noun.kind == "door":
        return ground.stopped_at_door()
    if noun.kind == "unknown":
        return Found(np.zeros(len(ground.along_m), dtype=bool), _unknown(noun))
    return None


def _after_stop(index: int, clause: Clause, ground: Ground) -> list[Claim]:
    """What follows the last stop tells how it looks there; it must not go on walking."""
    everywhere = np.ones(len(ground.along_m), dtype=bool)
    if clause.verb in MOVING and not clause.until and not clause.meanwhile:
        return [Claim(index, "false", everywhere, "the text goes on after its stop")]
    result = []
    for noun in clause.nouns:
        found: Found | None
        seen = clause.verb == "see" or noun.prep == "with" or not clause.until
        if clause.until and clause.verb == "see" and noun.side and noun.kind == "object":
            found = ground.beside(noun)
        elif seen and not clause.before:
            found = _claim_found(noun, ground, "see")
        else:
            found = _stop_noun(noun, ground)
        if found is None:
            continue
        # A side is that of the very end.
        near = found.mask & ground.at_goal(0.6 if noun.side else 2.6)
        if found.reason or not near.any():
            reason = found.reason or f"the {noun.text} is not so at the end of the path"
            result.append(Claim(index, "false", everywhere, reason))
    return result


def _nouns(index: int, clause: Clause, ground: Ground, verb: str) -> list[Claim]:
    claims = []
    for noun in clause.nouns:
        inside = clause.until and verb == "see" and noun.prep == "in"
        # "Until there is a shelf on your right": it is beside the walker then.
        beside = clause.until and verb == "see" and bool(noun.side) and noun.kind == "object"
        claim = _noun(index, noun, ground, "" if inside else "pass" if beside else verb)
        if claim is not None:
            still = clause.meanwhile or (claim.still and not clause.until)
            claims.append(replace(claim, still=still))
    pair = [k for k, n in enumerate(clause.nouns) if n.prep == "between"]
    if len(pair) == 2 and len(claims) == len(clause.nouns):
        claims = _joined(claims, pair[0], pair[1], ground)
    if claims and claims[-1].kind == "place" and any(n.prep == "around" for n in clause.nouns):
        claims[-1] = replace(claims[-1], bends=True)
    return claims


def _joined(claims: list[Claim], a: int, b: int, ground: Ground) -> list[Claim]:
    """The claims, with those of both nouns of `between` as one: both are near at one place."""
    first, second = claims[a], claims[b]
    if "false" in (first.kind, second.kind):
        return claims
    mask = spread(first.mask, ground.along_m, 0.25) & spread(second.mask, ground.along_m, 0.25)
    if not mask.any():
        reason = f"nothing on the path lies between {first.reason} and {second.reason}"
        return [*claims[:a], replace(first, kind="false", reason=reason)]
    return [*claims[:a], replace(first, mask=mask), *claims[b + 1 :]]


def _noun(index: int, noun: Noun, ground: Ground, verb: str) -> Claim | None:
    found = _claim_found(noun, ground, verb)
    if found is None:
        return None
    if found.reason:
        return Claim(index, "false", found.mask, found.reason)
    leaving = noun.prep == "from" or (verb == "leave" and not noun.prep)
    through = noun.kind in ("room", "door", "generic") and (
        noun.prep in ("into", "through") or verb == "enter"
    )
    through = through or (noun.kind == "door" and verb == "move" and not noun.prep)
    kind = "exit" if leaving else "door" if through else "place"
    still = verb == "see" or noun.prep == "with"
    slack = (1.5 if noun.side else 4.0) if still else 0.5
    if noun.prep == "between":  # one place; which of the two is named first says nothing
        slack = 2.0
    named = noun.text if noun.kind != "generic" else "room"
    passed = noun.kind == "object" and (noun.prep == "past" or (verb == "pass" and not noun.prep))
    return Claim(
        index, kind, found.mask, f"the {named}", side=noun.side, slack_m=slack, still=still,
        abeam_m=ground.abeam(noun) if passed and not still else None,
    )  # fmt: skip


def _claim_found(noun: Noun, ground: Ground, verb: str) -> Found | None:
    prep = noun.prep
    if noun.kind == "unknown":
        return Found(np.zeros(len(ground.along_m), dtype=bool), _unknown(noun))
    if noun.kind == "object":
        return _object(noun, ground, verb, prep)
    if noun.kind == "room":
        return _room(noun, ground, verb, prep)
    if noun.kind == "door":
        if prep in ("through", "into", "from", "to", "on") or verb in ("enter", "leave"):
            if prep == "to" and not noun.side:
                return ground.door_near(noun)
            return ground.through_door(noun)
        if verb == "see" or prep == "with":
            return ground.door_near(noun, 6.0)
        if verb == "move" and not prep:  # "take the second door on the left"
            return ground.through_door(noun)
        return ground.door_near(noun)
    moving = prep in ("into", "from", "through") or verb in ("enter", "leave")
    if noun.head in ("room", "rooms", "one") and moving:
        if noun.ordinal or not ground.facts.passages:
            return None
        return ground.through_door(Noun(noun.text, "door", "door"))
    return None


def _object(noun: Noun, ground: Ground, verb: str, prep: str) -> Found:
    if prep == "with" or verb == "see":
        return ground.seen_at(noun)
    if prep in ("past", "along", "around", "between", "through", "after") or verb == "pass":
        return ground.passed(noun)
    if prep in ("to", "on") and verb != "reach":
        return ground.headed_for(noun)
    if verb == "reach" or prep in ("at", "near", "before", "in", "into"):
        return ground.reached(noun)
    if prep in ("from", "away"):
        return ground.passed(noun)
    if verb in ("move", "leave"):
        return ground.passed(noun)
    return ground.seen_at(noun)


def _room(noun: Noun, ground: Ground, verb: str, prep: str) -> Found:
    if noun.part in ("end", "far"):
        return ground.room_end(noun)
    if verb == "see" or prep == "with":
        return ground.room_in_view(noun)
    if prep == "from" or (verb == "leave" and prep != "into"):
        return ground.left(noun)
    if prep == "into" or verb in ("enter", "reach"):
        return ground.entered(noun)
    if prep == "to" or prep == "on":
        return ground.room_ahead(noun)
    if prep in ("at", "before", "near"):
        return ground.room_ahead(noun)
    return ground.inside(noun)


def _unknown(noun: Noun) -> str:
    return f"nothing here is called {noun.text!r}"
