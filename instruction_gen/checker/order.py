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
from .fit import NEVER, WRONG, Costs, Fit, Part, best, ramp
from .ground import Ground
from .said import Said
from .turns import events_of, left_out, made, no_turn, unsaid

LIMIT = 0.66  # the root of the sum of the squares of all costs
_FIRST = 0.35  # who meets what costs no more than this means it
_STAYS_M = 4.0, 7.0
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
    if placed.cost <= LIMIT:
        return []
    worst = [(k, *max(told)) for k, told in enumerate(placed.told)]
    most = min(1.0, max(cost for _, cost, _ in worst))
    return [Problem(k, reason) for k, cost, reason in worst if cost >= most]


def step_starts_m(steps: Sequence[Step], ground: Ground) -> tuple[float, ...]:
    """Return how far along the path each step begins: where all before it can be done [m]."""
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

    def __init__(self, ground: Ground, claims: Sequence[Claim], owners: Sequence[int]):
        self.ground, self.along, self.turns = ground, ground.along_m, events_of(ground)
        self._within = ""  # the room that the text is in
        cost = np.full((len(self.turns) + 1, ground.places), np.inf)
        cost[0, 0] = 0.0
        moves: list[_Moved] = []
        for index, claim in enumerate(claims):
            said = Said(claims, owners, index)
            moves.append((self._turn if claim.kind == "turn" else self._place)(said, cost))
            cost = moves[-1][0]
        self.cost = float(np.sqrt(cost.min()))
        self.places, self.told = [0] * len(moves), [[(0.0, "")] for _ in moves]
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
                return climbs.on_stairs(ground, claim)
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
        again = any(names & own for own in rooms) or facts.level_rooms.count(said.claim.name) > 1
        return NEVER * (not again and any(v.room in names for v in facts.visits[1:]))

    # moves ------------------------------------------------------------------------------------

    def _back(self, said: Said) -> float:
        """Return how far behind the walker the place of a claim may be [m]."""
        kind, last = said.claim.kind, said.last.kind
        if kind == "climb" and (last == "climb" or said.last.what == "storey"):
            return max((c.to_m - c.along_m for c in self.ground.facts.climbs), default=0.0)
        if kind in ("pass", "in", "reach") and said.claim.what != "door" and said.paced_m:
            return said.paced_m + 0.5  # on that stretch
        if kind == "pass" and last == "turn" and not said.apart:
            return 1.8  # "turn right after the bench"
        if kind == "door" and last == "turn":
            return 0.3
        if kind in ("pass", "reach") and last in ("enter", "door") and said.apart:
            return 0.2  # not what stands in the room before
        return {"pass": 0.0, "see": 4.0, "reach": 1.5}.get(kind, 0.9 if last == "turn" else 0.4)

    def _stays(self, said: Said) -> tuple[float, float] | None:
        """Return how far ahead the place of a claim may be that does not move the walker [m]."""
        claim, then = said.claim, said.following
        if claim.kind in ("pass", "in", "reach") and claim.what != "door" and said.paced_m:
            return 1.5, 3.0
        until = claim.kind == "see" and (then.kind, then.what) == ("stop", "")
        paced = claim.kind == "in" and then.kind == "walk" and then.metres > 0.0
        return _STAYS_M if paced or (claim.kind in ("see", "avoid") and not until) else None

    def _moves(
        self, said: Said, fit: Fit, stays: tuple[float, float] | None
    ) -> list[tuple[Costs, str]]:
        """Return what it costs to go from one place (rows) to another (columns) by a claim."""
        claim, along, kind = said.claim, self.along, said.claim.kind
        here, there, end = along[:, None], along[None, :], along[-1]
        went, led_to = there - here, said.led_to
        name = f"the {claim.text or 'doorway'}"
        back_m = self._back(said)
        parts: list[Part] = []

        def add(cost: Costs | float, reason: str) -> None:
            parts.append((cost, reason))

        add(
            ramp(-went, back_m, back_m + 0.6),
            f"{name} comes earlier on the path than the text says",
        )
        if stays:
            add(ramp(went, *stays), f"{name} comes later on the path than the text says")
        own = claim.ordinal or (claim.what == "door" and (claim.side or claim.room or claim.name))
        meant = kind == "door" or (claim.what == "thing" and kind in ("pass", "see", "reach"))
        if meant and not own:
            add(self._beyond_first(fit), f"the first {claim.text} on the way is another one")
        if (kind, claim.what) == ("pass", "room") == (said.last.kind, said.last.what):
            first_m = np.fmin.reduce(self.ground.doors_m(said.last), axis=0, initial=np.nan)
            then_m = np.fmax.reduce(self.ground.doors_m(claim), axis=0, initial=np.nan)
            other = then_m < first_m[:, None] - 0.5
            add(WRONG * other, f"{name} comes before the {said.last.name}")
        if kind == "walk" and (claim.metres or claim.vague) and not said.stopped:
            d = claim.metres
            low = np.minimum(0.2, end - 0.3 - here) if claim.vague else 0.85 * d - 0.2
            high = max(4.5, 2.0 * d) if claim.vague else 1.15 * d + 0.15
            off = ramp(low - went, 0.0, 0.1 * d + 0.1), ramp(went - high, 0.0, 0.12 * d + 0.1)
            add(np.maximum(*off), f"the path does not go on for {d:g} metres")
        elif said.paced_m and (kind in ("door", "enter", "leave", "stop") or claim.what == "door"):
            add(ramp(np.abs(went), 0.1, 0.5), f"{name} is farther than the distance before it")
        if kind in ("enter", "door", "leave") and led_to.kind in ("door", "turn"):
            # One manoeuvre, which goes through no other room.
            if (led_to.kind == "door" and kind != "leave") or led_to.side == claim.side:
                add(ramp(went, 0.8, 1.8), f"{name} is not where the text turns or leads through")
            if kind != "leave":
                between = self._rooms_before(0.9) - self._rooms_before(0.4)[:, None]
                add(0.75 * WRONG * np.maximum(between, 0.0), f"another room comes before {name}")
        if kind in ("leave", "in") and claim.name and not said.moved:
            one = float(kind == "in")
            late = np.maximum(self._rooms_before(0.9 + one) - one, 0.0)
            add(0.75 * WRONG * late, f"the path does not start in {name}")
        if kind == "stop":
            add(ramp(end - there, 0.0, 0.1), "the path goes on")
            if not claim.what:
                add(ramp(went, 2.2, 3.6), "the path goes on farther than what is named before")
            elif claim.what == "thing" and not (claim.room or claim.ordinal):
                met = f"the first {claim.name} on the way is not where the path ends"
                add(self._met_before(said, fit), met)
        elif said.stopped and kind not in ("avoid", "walk"):
            add(ramp(end - there, 0.6, 1.2), f"{name} is not where the path ends")
        if said.is_pair and not self.ground.flank(said.last, claim, kind == "stop"):
            add(NEVER, f"one is not between the {said.last.name} and {name}")
        return [(np.broadcast_to(cost, (len(along),) * 2), reason) for cost, reason in parts]

    def _rooms_before(self, by_m: float) -> Costs:
        """Return (S,) how many passages lie more than `by_m` before a place."""
        at = np.array([p.along_m for p in self.ground.facts.passages])
        return (at[:, None] < self.along - by_m).sum(axis=0).astype(np.float64)

    def _beyond_first(self, fit: Fit) -> Costs:
        """Return (S, S) what it costs to go from a place on past the first that would fit."""
        end, good = np.full(len(self.along) + 1, np.inf), [*(fit.first <= _FIRST), False]
        for k in range(len(self.along) - 1, -1, -1):
            end[k] = self.along[k] if good[k] and not good[k + 1] else end[k + 1]
        return ramp(self.along[None, :] - end[:-1, None], 2.0, 4.0)

    def _met_before(self, said: Said, fit: Fit) -> Costs:
        """Return (S, 1) what it costs that a thing to stop at is met in an earlier room."""
        told = any(c.kind == "stop" and c.what == "room" for c in said.claims)
        good = (fit.first <= _FIRST) & (self.along < self.ground.facts.visits[-1].from_m - 1.0)
        later = np.logical_or.accumulate(good[::-1])[::-1]
        return 0.75 * WRONG * (later & (not told))[:, None]

    # claims -----------------------------------------------------------------------------------

    def _place(self, said: Said, before: Costs) -> _Moved:
        """Move on to the place of a claim that is no turn."""
        claim, name = said.claim, said.claim.text or "doorway"
        fit = self._fit(said)
        own, stays, seen = fit.cost, self._stays(said), np.arange(len(self.along))
        parts = self._moves(said, fit, stays)
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
