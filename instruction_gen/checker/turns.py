"""What it costs to call a bend a turn, and to leave a turn of the path unsaid."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..facts.records import ClimbFact, TurnFact
from ..language.claims import Claim
from .climbs import reaches_storey
from .fit import NEVER, WRONG, Costs, Mask, ramp
from .ground import Ground
from .said import WAYS, Said

_UNSAID_DEG, _STRAIGHT_DEG, _CONTRARY_DEG = (38.0, 62.0), (30.0, 55.0), (20.0, 45.0)
_LED, _AT_EDGE = 0.2, 0.3  # how much a turn counts that is led around, or at an end of the path
_START_M, _START_DEG, _END_M = 0.3, 100.0, 0.9
_BEFORE_DOOR_M, _NEAR_M = 2.6, 2.5
_ONE_BEND_M, _TWICE_DEG, _TOO_SLIGHT, _TOLD_TWICE = 2.2, 95.0, 0.8, 0.3
_SEE_M, _SEE_DEG = 8.0, 125.0
_AT_LANDING_M, _AT_STAIRS_M = 0.5, 1.2


@dataclass(frozen=True)
class Made:
    """A claimed turn.

    Attributes:
        first, after: the turns that it is, `first` up to `after`.
        cost: of calling them that.
        start: (S,) of coming from a place.
        at: (S,) where the walker may be then.
    """

    first: int
    after: int
    cost: float
    start: Costs
    at: Mask


def unsaid(ground: Ground, said: Said) -> Costs:
    """Return (T, S) what it costs to leave turns unsaid up to a claim at a place."""
    events = events_of(ground)
    result = np.zeros((len(events), ground.places))
    if all(claim.kind == "stop" for claim in said.claims):
        return result  # a text that names the goal alone tells no way
    for j, turn in enumerate(events):
        cost = left_out(ground, turn, said.straight)
        if isinstance(turn, ClimbFact):
            told = said.claim.kind == "climb" or reaches_storey(ground, said.claim, turn)
            result[j] = 0.0 if told else cost
            continue
        if ground.facts.on_stairs(turn.along_m):
            continue
        if said.claim.kind == "climb" and (to_m := _to_stairs_m(ground, turn)) < np.inf:
            result[j] = min(cost, 1.0) * _LED * (to_m > _AT_STAIRS_M)
            continue
        led = np.where(_led_around(ground, said, turn), _LED, 1.0)
        off_m = [turn.along_m - climb.to_m for climb in ground.facts.climbs]
        if said.claim.kind != "climb" and any(0.0 <= m <= _AT_STAIRS_M for m in off_m):
            led = np.where(ground.along_m > turn.along_m, _LED, led)  # where one gets off them
        contrary = _contradicted(ground, said, turn)
        result[j] = np.where(contrary, ramp(abs(turn.angle_deg), *_CONTRARY_DEG), cost * led)
    return result


def events_of(ground: Ground) -> list[TurnFact | ClimbFact]:
    """Return the turns and climbs of a path, in order."""
    return sorted((*ground.facts.turns, *ground.facts.climbs), key=lambda e: e.along_m)


def left_out(
    ground: Ground, turn: TurnFact | ClimbFact, straight: bool, ends: bool = True
) -> float:
    """Return what it costs to say nothing of a turn or climb, or that the way is straight.

    Args:
        ends: a turn at an end of the path counts less.
    """
    if isinstance(turn, ClimbFact):
        return NEVER
    if ground.facts.on_stairs(turn.along_m):
        return 0.0  # they lead around
    length_m = ground.length_m if ends else np.inf
    start = turn.along_m < _START_M and abs(turn.angle_deg) < _START_DEG
    edge = start or turn.along_m > length_m - _END_M
    cost = ramp(abs(turn.angle_deg), *(_STRAIGHT_DEG if straight else _UNSAID_DEG))
    return float(cost) * (_AT_EDGE if edge else 1.0)


def _to_stairs_m(ground: Ground, turn: TurnFact) -> float:
    """Return how far stairs are behind a turn, inf if none follow [m]."""
    off_m = (climb.along_m - turn.along_m for climb in ground.facts.climbs)
    return min((m for m in off_m if m >= 0.0), default=np.inf)


def _contradicted(ground: Ground, said: Said, turn: TurnFact) -> Mask:
    """Return (S,) whether turns that are said around a claim go the other way."""
    claim, (since, then) = said.claim, said.neighbours
    others = [c.kind == "turn" and c.side not in (turn.side, "around") for c in (since, then)]
    other = others[0] or (others[1] and not _doors(ground, turn, -0.1))
    around = (claim.kind, claim.degree) == ("pass", "slight") or claim.side == turn.side
    near = np.abs(ground.along_m - turn.along_m) <= _NEAR_M
    return (near | (claim.kind == "in")) & (other and not around)


def _led_around(ground: Ground, said: Said, turn: TurnFact) -> Mask:
    """Return (S,) whether a claim leads around a turn without saying it."""
    claim, then = said.claim, said.neighbours[1]
    onward = ground.along_m - turn.along_m
    led = np.zeros(ground.places, dtype=bool)
    if said.straight and claim.side not in ("left", "right"):
        return led
    if claim.kind in ("door", "enter", "leave"):
        if claim.side == turn.side:
            return np.abs(onward) <= _BEFORE_DOOR_M
        if then.kind == "turn" or (then.side == "ahead" and then.kind in WAYS):
            own = bool(_doors(ground, turn, -0.1))  # what is behind the door is said
            return (onward >= -0.6) & (onward <= _BEFORE_DOOR_M) & own
        return (onward >= -1.2) & (onward <= _BEFORE_DOOR_M)
    aside = claim.kind in ("see", "reach") and claim.side == turn.side
    if claim.what == "room" and (claim.kind in ("in", "stop") or aside):
        rooms = _doors(ground, turn, -1.0)
        return led | bool(ground.rooms(claim.name) & rooms)
    if claim.what == "thing" and claim.kind != "turn" and claim.degree == "slight":
        return ~led  # the way around a thing, or along it, bends
    if claim.what == "thing" and claim.kind in ("pass", "stop", "reach"):
        rows = ground.meant(claim)
        k = int(np.argmin(np.abs(onward + 0.4)))
        view = ground.seen[rows, k] & (ground.distance[rows, k] <= _SEE_M)
        view &= np.abs(ground.bearing[rows, k]) <= _SEE_DEG
        return (onward > (-2.0 if claim.kind == "pass" else 0.0)) & bool(view.any())
    return led


def _doors(ground: Ground, turn: TurnFact, from_m: float) -> set[str]:
    """Return the rooms behind the passages that a turn leads to."""
    return {p.to_room for p in ground.facts.passages
            if from_m <= p.along_m - turn.along_m <= _BEFORE_DOOR_M}  # fmt: skip


def made(ground: Ground, said: Said) -> Iterator[Made]:
    """Yield the turns of a path that a claimed turn may be."""
    turns, along, claim = events_of(ground), ground.along_m, said.claim
    landings = [m for climb in ground.facts.climbs for m in climb.landings_m]
    # Behind a door: what bends well before it is another turn.
    slack = 0.4 if said.last.kind in ("leave", "enter", "door") and said.apart else 1.0
    if said.on_landing:  # the storey that the stairs lead to may be said before
        slack = max((c.to_m - c.along_m for c in ground.facts.climbs), default=slack)
    for j, first in enumerate(turns):
        here = any(low - _AT_LANDING_M <= first.along_m <= high for low, high in landings)
        if isinstance(first, ClimbFact) or (said.on_landing and landings and not here):
            continue
        if said.off_stairs and ground.facts.on_stairs(first.along_m):
            continue
        if said.last.kind == "climb" and said.apart and _to_stairs_m(ground, first) < _NEAR_M:
            continue
        # Texts do not give the angle by which a landing turns.
        told = replace(claim, degree="") if here and claim.degree == "slight" else claim
        total = 0.0
        for after in range(j + 1, len(turns) + 1):
            own = turns[after - 1]
            if isinstance(own, ClimbFact):
                break
            apart_m = own.along_m - turns[max(after - 2, j)].along_m
            if own.side != first.side or apart_m > _ONE_BEND_M:
                break
            total += own.angle_deg
            start = ramp(along - own.along_m, slack, slack + 0.8)
            if said.paced_m:
                start = np.maximum(start, ramp(np.abs(along - own.along_m), 0.5, 1.0))
            at = along >= min(own.along_m + 0.25, along[-1] - 0.05)
            yield Made(j, after, _called(told, total, after - j), start,
                       at & (along <= own.along_m + 0.8))  # fmt: skip


def no_turn(ground: Ground, said: Said, count: int) -> Costs:
    """Return (S,) what it costs to turn where no other bend is, `count` turns being made.

    A bend may be too slight for the facts, and a wide one told as two turns.
    """
    along, claim, turns = ground.along_m, said.claim, ground.facts.turns
    last = events_of(ground)[count - 1] if count else None
    cost = np.full(len(along), 0.75 * WRONG)
    if said.on_landing and ground.facts.climbs:
        return cost
    if isinstance(last, TurnFact) and last.side == claim.side and abs(last.angle_deg) >= _TWICE_DEG:
        cost = np.maximum(ramp(np.abs(along - last.along_m), 2.0, 3.0), _TOLD_TWICE)
    if claim.degree == "slight":
        other = [
            ramp(-np.abs(along - t.along_m), -1.5, -0.7) for t in turns if t.side != claim.side
        ]
        cost = np.minimum(cost, _TOO_SLIGHT + np.max([0.0 * along, *other], axis=0))
    return cost


def _called(claim: Claim, degrees: float, bends: int) -> float:
    """Return what it costs to call bends to one side what a claim says."""
    size = abs(degrees)
    if claim.side == "around":
        return float(ramp(-size, -135.0, -115.0))
    if (degrees > 0) != (claim.side == "left"):
        return float(ramp(-size, -170.0, -158.0)) if bends == 1 else NEVER
    if claim.degree:
        return float(
            ramp(size, 66.0, 84.0) if claim.degree == "slight" else ramp(-size, -80.0, -62.0)
        )
    most_deg = 200.0 if bends == 1 else 130.0
    return float(max(ramp(-size, -38.0, -16.0), ramp(size, most_deg, most_deg + 20.0)))
