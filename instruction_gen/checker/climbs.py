"""What it costs to say that stairs are taken, or where on stairs or on which storey one is."""

import numpy as np

from ..facts.records import ClimbFact
from ..language.claims import Claim
from ..language.lexicon import STOREY_PHRASES
from ..language.words import ORDINALS
from .fit import NEVER, WRONG, Fit, best, never, ramp
from .ground import Ground

_ON_M = 0.3  # who is so far up or down has taken the stairs
_END_M = 0.8, 1.8  # from their top or bottom


def climbed(ground: Ground, claim: Claim) -> Fit:
    """Return what it costs to say that stairs are taken, up or down as said."""
    way = f" {claim.way}" if claim.way else ""
    climbs = [c for c in ground.facts.climbs if claim.way in ("", c.way)]
    if not climbs:
        return never(ground.places, f"the path takes no stairs{way}")
    unit = "storeys" if claim.what == "storey" else "flights"
    far, told, sides = [], [], []
    for climb in climbs:
        low, high = climb.along_m, climb.to_m
        if claim.place == "halfway":
            low, high = 0.85 * low + 0.15 * high, 0.15 * low + 0.85 * high
        off_m = np.maximum(low + _ON_M - ground.along_m, ground.along_m - high)
        far.append(ramp(off_m, 0.2, 0.5))
        number = len(climbs) if claim.what == "storey" else 1 + len(climb.landings_m)
        told.append(WRONG * (max(claim.count, claim.ordinal) > number))
        sided = claim.side in ("left", "right", "ahead")
        sides.append(ground.door_side(climb, claim.side) if sided else 0.0)
    return best(
        (len(far), ground.places),
        [(np.array(far), f"the stairs{way} come elsewhere on the path"),
         (np.array(told)[:, None], f"there are not {max(claim.count, claim.ordinal)} {unit}")],
        [(np.array(sides)[:, None], f"the stairs are not on the {claim.side}")],
    )  # fmt: skip


def on_stairs(ground: Ground, claim: Claim, climbed: bool) -> Fit:
    """Return what it costs to be at the top, at the bottom or on the landing of stairs.

    Args:
        climbed: the text has taken stairs; then it is at their end.
    """
    off = [NEVER + 0.0 * ground.along_m]
    for climb in ground.facts.climbs:
        first, then = ("bottom", "top") if climb.way == "up" else ("top", "bottom")
        ends = {first: np.inf if climbed else climb.along_m, then: climb.to_m}
        if claim.place in ends:
            on = (ground.along_m > climb.along_m) & (ground.along_m < climb.to_m)
            off.append(np.abs(ground.along_m - ends[claim.place]) + _ON_M * on)
        else:
            third_m = (climb.to_m - climb.along_m) / 3.0
            middle = 0.5 * (climb.along_m + climb.to_m)
            off.append(np.maximum(np.abs(ground.along_m - middle) - 0.5 * third_m, 0.0))
    far = ramp(np.min(off, axis=0), *_END_M)
    return best((1, ground.places), [(far, f"this is not the {claim.place} of the stairs")])


def ahead(ground: Ground, claim: Claim) -> Fit:
    """Return what it costs to say that stairs that are taken next are on a side."""
    climbs = ground.facts.climbs
    far = np.array([ramp(c.along_m - ground.along_m, 5.0, 8.0) for c in climbs])
    side = np.array([ground.door_side(climb, claim.side) for climb in climbs])[:, None]
    fault = f"the {claim.name} are not on the {claim.side}"
    return best(far.shape, [(far, "the stairs come later")], [(side, fault)])


def on_storey(ground: Ground, claim: Claim, reached: bool) -> Fit:
    """Return what it costs to say that one is on a storey, perhaps on one that stairs reach."""
    facts = ground.facts
    level = np.array([facts.level_at(along) for along in ground.along_m])
    level[[facts.on_stairs(along) for along in ground.along_m]] = -1
    if reached and facts.climbs:
        level[ground.along_m < facts.climbs[0].to_m] = -1
    levels = storeys_called(ground, claim.name)
    other = NEVER * (~np.isin(level, levels) & (facts.levels > 1))
    return best((1, ground.places), [(other, f"this is not the {claim.name}")])


def storeys_called(ground: Ground, name: str) -> list[int]:
    """Return the levels that a storey's name may mean.

    Who says "first floor" may count from the ground or from the floor above it, and the lowest
    level may be a basement.
    """
    facts = ground.facts
    every = range(facts.levels)
    visited = {facts.level, *(climb.to_level for climb in facts.climbs)}
    result: list[int] = []
    for own in STOREY_PHRASES.get(name, ()):
        nth = ORDINALS.get(own.split()[0], 0)
        if nth:
            result += [nth - 1, nth]
        elif own == "next floor":
            result += visited - {facts.level}
        elif own == "top floor":
            result += [facts.levels - 1]
        elif own == "ground floor":
            result += [0, 1] if facts.levels > 2 else [0]
        elif own == "upstairs":
            result += [k for k in every if k > min(visited)] or every[1:]
        else:
            result += [k for k in every if k < max(visited)] or every[:-1]
    return result


def reaches_storey(ground: Ground, claim: Claim, climb: ClimbFact) -> bool:
    """Return whether a claim names the storey, or a place on it, that stairs lead to."""
    landing = claim.name == "landing" and climb.landings_m
    if landing or claim.what == "storey" or claim.place in ("top", "bottom", "halfway"):
        return True
    if claim.what != "room" or claim.kind not in ("enter", "in", "stop"):
        return False
    visits = ground.facts.visits
    before = {v.room for v in visits if v.from_m < climb.along_m}
    after = {v.room for v in visits if v.from_m >= climb.to_m - 0.1}
    names = ground.rooms(claim.name)
    return bool(names & after - before)
