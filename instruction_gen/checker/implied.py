"""Turns that a text need not tell, because what it names next leads around them."""

import numpy as np

from ..facts.records import TurnFact
from ..language.lexicon import DOORS
from .claim import Claim
from .ground import Ground, Mask

# A turn of this much must be mentioned.
_REQUIRED_DEG = 58.0
IMPLIED_M = 1.4  # a room entered this near to a turn implies that turn
_IMPLIED_DEG = 65.0
_IMPLIED_AFTER_M = 0.1
_OTHER_SIDE_DEG = 35.0  # a door mentioned on one side hides no turn to the other
_SIDED_M = 2.2  # so does a door on that side
_INSIDE_DEG = 130.0
_ROUND_M = 1.5  # a turn made this near to a thing that is walked around
_THRESHOLD_M = 0.3  # a turn this shortly before a passage is made in the room behind it, too
_BEFORE_M = 0.4  # one nearer to a passage is made on leaving through it,
_ASIDE_DEG = 30.0  # unless the passage lies this far aside
_IN_VIEW_M = 1.5
_PAST_DOOR_M = 0.5  # a turn nearer to the passage behind one may be made on coming in
SPOT_M = 0.6

_NAMELESS = DOORS | {"room"}


class Implied:
    """Which turns of a path must be told, and which a claim tells by what it names.

    Attributes:
        required: of each turn whether it must be told.
    """

    def __init__(self, ground: Ground):
        """Read the turns of a path."""
        self.ground = ground
        self.along = ground.along_m
        self.turns = ground.facts.turns
        self.required = [_required(t, ground) for t in self.turns]

    def between(self, low_m: float, high_m: float) -> Mask:
        """Return the places of a stretch."""
        half = self.along[1] / 2
        return (self.along >= low_m - half) & (self.along <= high_m + half)

    def following(self, made: int) -> int | None:
        """Return the first turn after `made` ones that must be told, None when none is left."""
        return next((k for k in range(made, len(self.turns)) if self.required[k]), None)

    def limit(self, made: int) -> float:
        """Return how far one may be after `made` turns: to the next that must be told."""
        following = self.following(made)
        return np.inf if following is None else self.turns[following].along_m

    def after(self, made: int, claim: Claim) -> list[int]:
        """Return how many turns may be made once a claim holds: entering a room implies one."""
        options = list(range(made, self.led(made, claim) + 1))
        if claim.bends:
            return sorted({*options, *self._rounded(made, claim)})
        options += [k + 1 for k in self._to_the_other_opening(made, claim)]
        if self._only_way_out(claim):
            # The turn to the only door of a room need not be described.
            out_m = self.ground.facts.passages[0].along_m
            inside = [k for k, t in enumerate(self.turns) if t.along_m <= out_m]
            options += [k + 1 for k in inside if k >= made]
        if claim.kind != "door" and not (claim.kind == "exit" and claim.side):
            return options
        for k in range(made, len(self.turns)):
            turn = self.turns[k]
            sided = bool(claim.side) and claim.side == turn.side
            early = -_SIDED_M if sided else -IMPLIED_M
            near = any(
                early <= turn.along_m - p <= _IMPLIED_AFTER_M
                for p in self.ground.passages_m
                if (claim.mask & self.between(p - 0.4, p + 0.4)).any()
            )
            named = claim.reason.removeprefix("the ") not in _NAMELESS or sided
            against = bool(claim.side) and not sided and abs(turn.angle_deg) > _OTHER_SIDE_DEG
            if near and claim.counted and not against and not claim.turned:
                options.append(k + 1)
            elif near and named and not against and (abs(turn.angle_deg) <= _IMPLIED_DEG or sided):
                if claim.turned and self.required[k]:
                    break
                options.append(k + 1)
            elif self.required[k]:
                break
        return sorted(set(options))

    def led(self, made: int, claim: Claim) -> int:
        """Return how many turns may be made on the way to what a claim names.

        A text need not mention a turn towards the only opening that leads to a room, nor towards
        the thing to stop at, when it is in view and cannot be mistaken for another one.
        """
        led = made
        if not claim.rooms and claim.view is None:
            return made
        for k in range(made, len(self.turns)):
            if self.required[k]:
                if not (self._towards_room(k, claim) or self._towards_thing(k, claim)):
                    break
                led = k + 1
        return led

    def _towards_room(self, k: int, claim: Claim) -> bool:
        """Return whether turn `k` is made where just one opening leads to the room of a claim."""
        turn = self.turns[k]
        facts = self.ground.facts
        # A path that stops on the threshold of a room leads to it, too.
        rooms = [*({v.room} for v in facts.visits[1:]), set(facts.goal_rooms)]
        for visit, following in zip(facts.visits, rooms, strict=True):
            inside = visit.from_m - _THRESHOLD_M <= turn.along_m <= visit.to_m - _BEFORE_M
            if not (inside or self._towards_door(turn, visit.to_m)):
                continue
            openings = sum(name in claim.rooms for name in visit.beyond)
            near = claim.mask & self.between(visit.to_m - 0.4, visit.to_m + 0.4)
            against = bool(claim.side) and claim.side != turn.side
            if claim.turned or (against and visit.to_m - turn.along_m <= IMPLIED_M):
                continue
            if following & claim.rooms and openings == 1 and near.any():
                return True
        return False

    def _towards_door(self, turn: TurnFact, door_m: float) -> bool:
        """Return whether a turn just before a passage is made to reach it, not after it."""
        sign = 1 if turn.angle_deg > 0 else -1
        return (
            any(
                p.along_m == door_m and sign * p.bearing_deg > _ASIDE_DEG and turn.along_m < door_m
                for p in self.ground.facts.passages
            )
            and turn.along_m > door_m - _BEFORE_M
        )

    def _towards_thing(self, k: int, claim: Claim) -> bool:
        """Return whether the thing at a stop is in view, unmistakably, where turn `k` is made."""
        turn = self.turns[k]
        if claim.view is None:
            return False
        here = self.between(turn.along_m - _IN_VIEW_M, turn.along_m + 0.3)
        beyond = claim.mask & (self.along >= turn.along_m - SPOT_M)
        return bool((claim.view & here).any() and beyond.any())

    def leads_out(self, made: int, after: int, claim: Claim) -> bool:
        """Return whether the turns from `made` to `after` are on the only way out of a room."""
        other = set(self._to_the_other_opening(made, claim))
        return self._only_way_out(claim) or other.issuperset(range(made, after))

    def _only_way_out(self, claim: Claim) -> bool:
        """Return whether a claim is that the first room is left, by the only opening it has."""
        facts = self.ground.facts
        if claim.kind != "exit" or claim.side or not facts.passages or facts.visits[0].exits != 1:
            return False
        out_m = facts.passages[0].along_m
        return bool((claim.mask & self.between(out_m - 0.4, out_m + 0.4)).any())

    def _to_the_other_opening(self, made: int, claim: Claim) -> list[int]:
        """Return the turns made in a room of two openings that a claim leads out of.

        One came in by the other, so there is nowhere else to go.
        """
        if claim.kind not in ("door", "exit") or claim.turned or claim.side:
            return []
        result: list[int] = []
        for visit in self.ground.facts.visits[1:-1]:
            out = claim.mask & self.between(visit.to_m - 0.4, visit.to_m + 0.4)
            if visit.exits != 2 or not out.any():
                continue
            for k in range(made, len(self.turns)):
                inside = visit.from_m + _PAST_DOOR_M <= self.turns[k].along_m <= visit.to_m + 0.1
                if self.required[k] and not inside:
                    break
                if inside:
                    result.append(k)
        return result

    def _rounded(self, made: int, claim: Claim) -> list[int]:
        """Return the numbers of turns that may be made on the way around a thing."""
        options = [made]
        for k in range(made, len(self.turns)):
            turn = self.turns[k]
            near = claim.mask & self.between(turn.along_m - _ROUND_M, turn.along_m + _ROUND_M)
            against = claim.side in ("left", "right") and turn.side != claim.side
            if against and not self.required[k]:
                continue
            if not near.any() or against or abs(turn.angle_deg) > _INSIDE_DEG:
                break
            options.append(k + 1)
        return options


def _required(turn: TurnFact, ground: Ground) -> bool:
    if turn.along_m > ground.length_m - 0.7:
        return False
    return abs(turn.angle_deg) >= _REQUIRED_DEG
