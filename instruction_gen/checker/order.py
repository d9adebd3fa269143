"""The best placement of a text's claims along a path, and what it costs.

A state is a place on the path and the number of its turns and climbs that are behind the walker.
Each claim moves the walker on at a cost: of its target at the new place, of going back, of turns
that it does not say. Dynamic programming finds the cheapest way through all claims. A text is
refused where that costs too much; the dearest claims on it say why.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..facts.records import ClimbFact, TurnFact
from ..language.claims import Claim, Step
from ..language.stairs import is_stairs
from . import climbs
from .fit import NEVER, Costs, Fit, best, ramp
from .ground import Ground
from .moves import costs_to_move, stays_m
from .said import Said, goal_last
from .turns import events_of, left_out, made, no_turn, unsaid

LIMIT = 0.66  # the root of the sum of the squares of all costs
_FEW = 10  # of more claims the sum may grow
_Told = list[tuple[float, str]]
_Moved = tuple[Costs, NDArray[np.int64], Callable[[int, int, int, int], _Told]]


@dataclass(frozen=True)
class Problem:
    """A claim that does not hold, by its place in the list, and why."""

    index: int
    reason: str


def check_order(claims: Sequence[Claim], owners: Sequence[int], ground: Ground) -> list[Problem]:
    """Return what does not hold, in order; `owners` are the numbers of the claims' steps."""
    placed = Alignment(ground, claims, owners)
    worst = [(k, *max(told)) for k, told in enumerate(placed.told)]
    each = max((cost for _, cost, _ in worst), default=0.0)
    if placed.cost <= LIMIT * max(1.0, len(claims) / _FEW) ** 0.5 and each <= LIMIT:
        return []
    most = min(1.0, max(cost for _, cost, _ in worst))
    return [Problem(k, reason) for k, cost, reason in worst if cost >= most]


def holds_somewhere(claim: Claim, ground: Ground) -> bool:
    """Return whether there is a place on the path where a claim alone holds."""
    fit = Alignment(ground, (), ())._fit(Said((claim,), (0,), 0))
    return bool(fit.cost.min() <= LIMIT)


def step_starts_m(steps: Sequence[Step], ground: Ground) -> tuple[float, ...]:
    """Return how far along the path each step begins: where all before it can be done [m]."""
    steps = goal_last(steps)
    owners = [k for k, step in enumerate(steps) for _ in step.claims]
    placed = Alignment(ground, [claim for step in steps for claim in step.claims], owners)
    starts_m, done_m = [], 0.0
    for number in range(len(steps)):
        starts_m.append(round(done_m, 2))
        at = (k for k, owner in zip(placed.places, owners, strict=True) if owner == number)
        done_m = max(done_m, *(float(ground.along_m[k]) for k in at), 0.0)
    return tuple(starts_m)


class Alignment:
    """The cheapest placement of claims.

    Attributes:
        cost: of the placement.
        places: of each claim, where it is done, an index into the ground's places.
        told: of each claim, what it costs there and why.
    """

    def __init__(
        self,
        ground: Ground,
        claims: Sequence[Claim],
        owners: Sequence[int],
        most: float = np.inf,
    ):
        """Place the claims; where that costs more than `most`, only the cost is of use."""
        self.ground, self.along, self.turns = ground, ground.along_m, events_of(ground)
        self._within = ""  # the room that the text is in
        cost = np.full((len(self.turns) + 1, ground.places), np.inf)
        cost[0, 0] = 0.0
        moves: list[_Moved] = []
        for index, claim in enumerate(claims):
            said = Said(claims, owners, index)
            moves.append((self._turn if claim.kind == "turn" else self._place)(said, cost))
            cost = moves[-1][0]
            if cost.min() > most**2:
                break
        self.cost = float(np.sqrt(cost.min()))
        self.places, self.told = [0] * len(moves), [[(0.0, "")] for _ in moves]
        if len(moves) < len(claims):
            return
        m, s = np.unravel_index(int(cost.argmin()), cost.shape)
        for k in range(len(moves) - 1, -1, -1):
            _, origin, told = moves[k]
            since_m, since_s = origin[:, m, s]
            self.places[k], self.told[k] = int(s), told(int(since_m), int(since_s), int(m), int(s))
            m, s = since_m, since_s

    def _fit(self, said: Said) -> Fit:
        ground, claim = self.ground, said.claim
        kind, what = claim.kind, claim.what
        if kind == "climb":
            return climbs.climbed(ground, claim)
        if what == "storey":
            return climbs.on_storey(ground, claim, said.last.kind == "climb")
        if is_stairs(claim) and ground.facts.climbs:
            if claim.place in ("top", "bottom", "halfway"):
                return climbs.on_stairs(ground, claim, any(c.kind == "climb" for c in said.before))
            if claim.side and kind in ("pass", "see", "reach") and said.climbs_next:
                return climbs.ahead(ground, claim)
        if kind == "avoid":
            return best(
                (1, ground.places), [(self._entered(said), f"the path does enter the {claim.name}")]
            )
        if kind == "walk" or (kind, what) == ("stop", ""):
            return best((1, ground.places), [(0.0, "")])
        if kind == "stop":
            return {"room": ground.stopped_in, "door": ground.stopped_at_door,
                    "thing": ground.stopped_at}[what](claim)  # fmt: skip
        if kind in ("door", "enter", "leave") or (kind == "in" and what != "room"):
            within = self._within if kind != "leave" else ""
            return ground.crossed(claim, within, said.turned)
        if what == "room":
            view = kind == "see" or (kind == "reach" and claim.side)
            return (
                ground.room_in_view
                if view
                else ground.room_passed
                if kind == "pass"
                else ground.inside
            )(claim)
        fit = {"pass": ground.passed, "see": ground.seen_at, "reach": ground.reached}[kind](claim)
        if kind == "pass" and what == "door" and claim.count > 1:
            row = np.vstack([fit.parts, ground.doors_passed(claim)])
            fit = Fit(
                row, (*fit.reasons, f"there are not {claim.count} doorways to pass"), fit.first
            )
        return fit

    def _entered(self, said: Said) -> float:
        """Return what it costs to say that a room is not entered."""
        facts, names = self.ground.facts, self.ground.rooms(said.claim.name)
        if is_stairs(said.claim):
            return NEVER * any(said.claim.way in ("", c.way) for c in facts.climbs)
        rooms = (
            self.ground.rooms(c.name) for c in said.before if c.kind in ("in", "enter", "leave")
        )
        again = any(names & own for own in rooms)
        return NEVER * (not again and any(v.room in names for v in facts.visits[1:]))

    def _place(self, said: Said, before: Costs) -> _Moved:
        """Move on to the place of a claim that is no turn."""
        claim, name = said.claim, said.claim.text or "doorway"
        fit = self._fit(said)
        own, stays, seen = fit.cost, stays_m(said), np.arange(len(self.along))
        parts = costs_to_move(self.ground, said, fit, stays)
        moves = np.max([cost for cost, _ in parts], axis=0)
        if stays:  # the walker stays where he is
            seen = np.maximum(moves, own).argmin(axis=1)
            own = np.maximum(moves, own).min(axis=1)
        if claim.kind == "climb" or claim.what == "storey":
            self._within = ""
        elif claim.what in ("door", "room") and said.index:
            room = claim.kind in ("enter", "in") and claim.what == "room"
            self._within = claim.name if room else ""
        left = unsaid(self.ground, said)
        # A turn that is behind the walker must have been said.
        pending = np.zeros_like(before)
        for m, turn in enumerate(self.turns):
            late = ramp(self.along - turn.along_m, 1.0, 2.2) * min(1.0, float(left[m].max()))
            pending[m] = NEVER if claim.kind == "stop" else 0.0 if stays else late
        if stays:
            result, source = before.copy(), np.indices(before.shape)[1]
        else:
            reached = before[:, :, None] + moves**2
            source = reached.argmin(axis=1)
            result = np.take_along_axis(reached, source[:, None], axis=1)[:, 0]
        origin = np.stack([np.indices(source.shape)[0], source])
        for m in range(1, len(result)):
            skipped = result[m - 1] + left[m - 1] ** 2
            better = skipped < result[m]
            result[m] = np.where(better, skipped, result[m])
            origin[:, m] = np.where(better, origin[:, m - 1], origin[:, m])

        def told(since_m: int, since_s: int, m: int, s: int) -> _Told:
            at = int(seen[s]) if stays else s
            every = [(float(cost[since_s, at]), reason) for cost, reason in parts]
            every.append((float(fit.cost[at]), fit.reason(at)))
            turns = [(float(left[j, s]), j) for j in range(since_m, m)] + [
                (float(pending[m, s]), m)
            ]
            place = "" if claim.kind == "stop" else f" before the {name}"
            return every + [(cost, f"{_event(self.turns[j])}{place} is not mentioned")
                            for cost, j in turns if cost]  # fmt: skip

        return result + np.maximum(own, pending) ** 2, origin, told

    def _turn(self, said: Said, before: Costs) -> _Moved:
        """Make a turn."""
        result, origin = np.full_like(before, np.inf), np.zeros((2, *before.shape), dtype=np.int64)
        straight = said.straight
        left = [left_out(self.ground, turn, straight, ends=False) for turn in self.turns]
        for turn in made(self.ground, said):
            for m in range(turn.first + 1):
                value = (
                    before[m] + turn.start**2 + turn.cost**2 + np.square(left[m : turn.first]).sum()
                )
                s, to = int(value.argmin()), turn.after
                better = turn.at & (value[s] < result[to])
                result[to, better], origin[:, to, better] = value[s], [[m], [s]]
        for m, row in enumerate(before):
            value = row + no_turn(self.ground, said, m) ** 2
            better = value < result[m]
            result[m, better] = value[better]
            origin[0, m, better], origin[1, m, better] = m, np.flatnonzero(better)
        side = "around" if said.claim.side == "around" else f"to the {said.claim.side}"

        def told(since_m: int, since_s: int, m: int, s: int) -> _Told:
            cost = float(np.sqrt(max(result[m, s] - before[since_m, since_s], 0.0)))
            return [(cost, f"there is no turn {side} here")]

        return result, origin, told


def _event(event: TurnFact | ClimbFact) -> str:
    """Return what the path does, in words."""
    if isinstance(event, ClimbFact):
        return f"the way {event.way} the stairs"
    return f"the turn to the {event.side}"
