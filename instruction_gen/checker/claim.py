"""What a noun phrase claims: a place of the path, a door gone through, or something false."""

from dataclasses import dataclass, replace

import numpy as np

from ..language.clauses import Clause, Noun
from ..language.lexicon import singular
from .ground import Found, Ground, Mask, room_names, spread
from .other_things import OTHER_THINGS

_ABREAST_M = 1.8


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
        still: it is seen or passed meanwhile and does not move the walker on.
        bends: a path around a thing, which implies the turns made there.
        optional: it may have been mentioned before.
        maybe: a turn that the words may describe, or may not.
        turned: a door whose clear turn the same clause describes.
        counted: a door told from others by its place in their order.
        abeam_m: where a thing that is passed once is beside the walker [m], None = unclear.
        rooms: canonical names of the room that it leads into, none where it leads into none.
        strength: of a false claim as a contradiction, see `align`.
        view: (S,) of a stop: from where the thing there is in view and unmistakable.
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
    optional: bool = False
    maybe: bool = False
    turned: bool = False
    counted: bool = False
    abeam_m: float | None = None
    rooms: frozenset[str] = frozenset()
    strength: float = 1.0
    view: Mask | None = None


def noun_claims(index: int, clause: Clause, ground: Ground, verb: str) -> list[Claim]:
    """Return the claims of all nouns of a clause with the number `index`."""
    claims = []
    # "The door on the right after the coat rack": one comes by the rack first.
    for noun in sorted(clause.nouns, key=lambda n: n.prep != "after"):
        inside = clause.until and verb == "see" and noun.prep == "in"
        # "Until there is a shelf on your right": it is beside the walker then.
        sided = noun.side in ("left", "right")
        beside = clause.until and verb == "see" and sided and noun.kind == "object"
        # "When you get to the shelf": it is reached then.
        there = clause.until and noun.prep == "to" and noun.kind == "object"
        doing = "" if inside else "pass" if beside else "reach" if there else verb
        claim = noun_claim(index, noun, ground, doing)
        if claim is not None:
            still = clause.meanwhile or (claim.still and not clause.until)
            claims.append(replace(claim, still=still))
            if verb == "see" and noun.kind == "room" and noun.side in ("left", "right"):
                # "The kitchen is on the left; go in": one comes in on that side.
                come = noun_claim(index, replace(noun, prep="into"), ground, "enter")
                if come is not None and come.kind == "door":
                    claims.append(replace(come, optional=True))
    pair = [k for k, n in enumerate(clause.nouns) if n.prep == "between"]
    if len(pair) == 2 and len(claims) == len(clause.nouns):
        claims = _joined(claims, pair[0], pair[1], ground)
    if claims and claims[-1].kind == "place" and any(n.prep == "around" for n in clause.nouns):
        claims[-1] = replace(claims[-1], bends=True, side=_inside(clause, ground))
    return claims


def _inside(clause: Clause, ground: Ground) -> str:
    """Return the side on which a thing lies that is walked around, "" where it is on both."""
    noun = next(n for n in clause.nouns if n.prep == "around")
    if noun.side or noun.kind != "object":
        return noun.side
    sides = [s for s in ("left", "right") if not ground.passed(replace(noun, side=s)).reason]
    return sides[0] if len(sides) == 1 else ""


def _joined(claims: list[Claim], a: int, b: int, ground: Ground) -> list[Claim]:
    """Return the claims, with the two of `between` joined: both things are near at one place."""
    first, second = claims[a], claims[b]
    if "false" in (first.kind, second.kind):
        return claims
    mask = spread(first.mask, ground.along_m, 0.8) & spread(second.mask, ground.along_m, 0.8)
    places = [m for m in (first.abeam_m, second.abeam_m) if m is not None]
    apart = len(places) == 2 and abs(places[0] - places[1]) > _ABREAST_M
    if not mask.any() or (apart and not (first.mask & second.mask).any()):
        reason = f"nothing on the path lies between {first.reason} and {second.reason}"
        return [*claims[:a], replace(first, kind="false", reason=reason)]
    return [*claims[:a], replace(first, mask=mask, abeam_m=None), *claims[b + 1 :]]


def noun_claim(index: int, noun: Noun, ground: Ground, verb: str) -> Claim | None:
    """Return the claim of a noun phrase, None when it claims nothing."""
    if noun.side == "behind" and verb == "leave":
        verb = "see"  # "leaving the doorway behind you" is no way through it
    found = found_at(noun, ground, verb)
    if found is None:
        return None
    if found.reason:
        return Claim(index, "false", found.mask, found.reason, strength=found.strength)
    leaving = noun.prep == "from" or (verb == "leave" and not noun.prep and noun.kind != "door")
    through = noun.kind in ("room", "door", "generic") and (
        noun.prep in ("into", "through")
        or verb == "enter"
        or (verb == "leave" and noun.prep == "to")
    )
    # "Take the second door on the left", or without a verb "second door on the left".
    bare = noun.kind == "door" and not noun.prep
    through = through or (bare and (verb == "move" or (not verb and bool(noun.side))))
    through = through or (noun.kind == "door" and verb in ("leave", "enter"))
    kind = "exit" if leaving else "door" if through else "place"
    still = verb == "see" or noun.prep == "with"
    slack = (1.5 if noun.side else 4.0) if still else 0.5
    if noun.prep == "between":  # one place; which of the two is named first says nothing
        slack = 2.0
    named = noun.text if noun.kind != "generic" else "room"
    passed = noun.kind == "object" and (
        noun.prep in ("past", "between") or (verb == "pass" and not noun.prep)
    )
    return Claim(
        index, kind, found.mask, f"the {named}", side=noun.side, slack_m=slack, still=still,
        counted=noun.kind == "door" and noun.ordinal > 0,
        abeam_m=ground.abeam(noun) if passed and not still else None,
        rooms=room_names(noun.head) if noun.kind == "room" and not leaving else frozenset(),
    )  # fmt: skip


def found_at(noun: Noun, ground: Ground, verb: str) -> Found | None:
    """Return where what a noun phrase says with its verb is true, None when it claims nothing."""
    prep = noun.prep
    if noun.kind == "unknown":
        return unknown(noun, ground, needed=prep == "past" or (verb == "pass" and not prep))
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
        if not prep and (verb == "move" or (not verb and noun.side)):
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
    if verb == "leave":  # "leave the bed behind you"
        return ground.beside(noun)
    if verb == "move" or (not verb and noun.side):
        return ground.passed(noun)
    return ground.seen_at(noun)


def _room(noun: Noun, ground: Ground, verb: str, prep: str) -> Found:
    if noun.part in ("end", "far", "finish"):
        return ground.room_end(noun)
    aside = noun.side in ("left", "right") and not verb and not prep
    if verb in ("see", "pass") or prep in ("with", "past") or aside:
        return ground.room_in_view(noun)
    if prep == "after":
        left = ground.left(noun)
        return ground.room_behind_opening(noun) if left.reason else left
    if prep == "from" or (verb == "leave" and not prep):
        return ground.left(noun)
    if prep == "into" or verb in ("enter", "reach", "leave"):
        return ground.entered(noun)
    if prep in ("to", "on", "at", "before", "near"):
        ahead = ground.room_ahead(noun)
        return ground.room_behind_opening(noun) if ahead.reason else ahead
    inside = ground.inside(noun)
    # "Go in the kitchen", on whose threshold the path ends.
    return ground.entered(noun) if inside.reason and verb in ("move", "turn") else inside


def unknown(noun: Noun, ground: Ground, *, needed: bool = False) -> Found | None:
    """Return why a phrase with a noun that no landmark has is false, None if it claims nothing.

    Args:
        needed: it has to be understood: nothing else says where this is, or one steers by it.
    """
    head = noun.text.split()[-1]
    if not needed and not OTHER_THINGS & {head, singular(head)}:
        return None
    if any(m.noun.startswith(singular(head)) for m in ground.facts.landmarks):
        return None  # "past the coats": what hangs on a coat rack is there, too
    nothing = np.zeros(len(ground.along_m), dtype=bool)
    return Found(nothing, f"nothing here is called {noun.text!r}")
