"""Which turns of a path a claimed turn may be, and which are led around without being claimed."""

from collections.abc import Sequence

import numpy as np

from ..facts.records import TurnFact, manoeuvre_deg
from ..language.claims import Claim
from .ground import Ground
from .things import Mask

CLEAR_DEG = 62.0  # a turn of this much is claimed, or led to by what is named next
_BEND_DEG, _WEAVE_DEG = 28.0, 35.0
_GENTLE_DEG, _SHARP_DEG, _AROUND_DEG = 76.0, 70.0, 125.0
_MERGED_DEG, _MOST_DEG = 130.0, 200.0  # of several bends and of one that are `turn left`
_ONE_BEND_M, _TWICE_DEG = 2.2, 95.0
_DONE_M = 0.4  # a walker looks along the new way so far behind a turn
_WAYS = ("walk", "in", "door", "leave", "enter")
_START_M, _START_DEG = 0.3, 100.0  # who starts to walk turns that way without being told
_END_M = 0.9
_LATE_M = 1.8  # how far beyond an unclaimed turn a claim may already lie
_SLACK_M, _BEHIND_M = 1.3, 0.25


class Turns:
    """The turns of a path and the claims of a text about it."""

    def __init__(self, ground: Ground, claims: Sequence[Claim]):
        """Find the first claim that leads around each turn.

        A text that names the goal alone (`bring me the towel in the bathroom`) tells no way: the
        walker finds it.
        """
        self.ground, self.claims = ground, claims
        self.along, self.turns = ground.along_m, ground.facts.turns
        told = any(claim.kind != "stop" for claim in claims)
        self._leads = [self._leader(turn) if told else -1 for turn in self.turns]

    def unclaimed(self, made: int, index: int, first_m: float) -> TurnFact | None:
        """Return the first turn that should have been claimed before claim `index`.

        Args:
            made: how many turns are made.
            index: of the claim.
            first_m: where the walker is [m].
        """
        for k, turn in enumerate(self.turns):
            if k >= made and self._leads[k] > index and turn.along_m > first_m - 0.5:
                return turn
        return None

    def limit_m(self, made: int, index: int, first_m: float) -> float:
        """Return how far the walker gets before a turn that should have been claimed [m]."""
        turn = self.unclaimed(made, index, first_m)
        return np.inf if turn is None else turn.along_m + _LATE_M

    def after(
        self, claim: Claim, index: int, made: int, here: Mask, tight: Mask | None
    ) -> dict[int, Mask]:
        """Return where the walker may be after a claimed turn, by the number of turns made.

        Args:
            tight: where a distance before the turn led.
        """
        result: dict[int, Mask] = {}
        ground, first = self.ground, float(self.along[np.argmax(here)])
        around = [c.kind for c in self.claims[max(index - 1, 0) : index + 2]]
        # "Leave the bedroom, left through the door": one door.
        behind = index > 0 and around[0] in ("leave", "enter", "door")
        behind = behind and (around[0], around[-1]) != ("leave", "door")
        # Behind a door: what bends well before it is another turn.
        from_m = first + _BEHIND_M if behind else first - _SLACK_M
        limit = self.limit_m(made, index, first)
        for k in range(made, len(self.turns)):
            if self.turns[k].along_m > limit or self._skips(made, k, here, claim):
                break
            for end in self._bends(k, claim, index):
                last = self.turns[end - 1].along_m
                around = ground.between(self.turns[k].along_m - 0.4, last + 0.4)
                if last < from_m or (tight is not None and not (tight & around).any()):
                    continue
                at = ground.between(self.turns[k].along_m + _DONE_M, last + 0.6)
                result[end] = result.get(end, np.zeros_like(at)) | at
            own = self.turns[k].side == claim.side and self.turns[k].along_m > first - 0.5
            if own and self._leads[k] > index:
                break  # the first clear turn to a side is meant
        still = self._again(made, here, claim) | self._slight(made, here, claim, index, tight)
        if still.any():
            result[made] = result.get(made, still) | still
        return result

    def _slight(self, made: int, here: Mask, claim: Claim, index: int, tight: Mask | None) -> Mask:
        """Return where a bend may be too slight for the facts.

        It may not where fewer turns to the other side are claimed from here on than the path makes:
        then it must be one of those.
        """
        others = [t for t in self.turns if t.side != claim.side]
        left = [t for t in others if t in self.turns[made:] and abs(t.angle_deg) >= _BEND_DEG]
        later = [c for c in self.claims[index:] if c.kind == "turn" and c.side != claim.side]
        if claim.degree != "slight" or len(left) > len(later):
            return np.zeros_like(here)
        first_m, here = float(self.along[np.argmax(here)]), here if tight is None else tight
        last_m = float(self.along[here][-1])
        if any(t.side == claim.side and first_m - 0.5 <= t.along_m <= last_m + _ONE_BEND_M
               for t in self.turns[made:]):  # fmt: skip
            return np.zeros_like(here)  # it is that one
        result = here | self.ground.between(last_m, last_m + 2.5)
        for turn in others:
            result &= ~self.ground.between(turn.along_m - 2.0, turn.along_m + 2.0)
        return result

    def _skips(self, made: int, k: int, here: Mask, claim: Claim) -> bool:
        """Return whether a turn to the other side, clear or larger, is left out before turn `k`."""
        first = int(np.argmax(here))
        last_m, own = (
            float(self.along[first + int(np.argmin([*here[first:], False])) - 1]),
            self.turns[k],
        )
        own_deg = abs(own.angle_deg) if own.side == claim.side else CLEAR_DEG
        least_deg = min(CLEAR_DEG, max(own_deg, _WEAVE_DEG))
        return any(
            t.side != claim.side and abs(t.angle_deg) >= least_deg and t.along_m > last_m - 1.0
            for t in self.turns[made:k]
        )

    def _again(self, made: int, here: Mask, claim: Claim) -> Mask:
        """Return where one wide bend may be told as two turns to the same side."""
        if made and self.turns[made - 1].side == claim.side:
            turn, onward = self.turns[made - 1], self.turns[made : made + 1]
            more = [
                t for t in onward if t.side == turn.side and t.along_m <= turn.along_m + _ONE_BEND_M
            ]
            if abs(turn.angle_deg) >= _TWICE_DEG and not more:
                return here & self.ground.between(turn.along_m - 0.3, turn.along_m + _ONE_BEND_M)
        return np.zeros_like(here)

    def _bends(self, k: int, claim: Claim, index: int) -> list[int]:
        """Return how many turns are made after a claimed turn that begins with turn `k`."""
        result, total, first = [], 0.0, self.turns[k]
        for j in range(k, len(self.turns)):
            turn = self.turns[j]
            apart_m = turn.along_m - self.turns[max(j - 1, k)].along_m
            if turn.side != first.side or apart_m > _ONE_BEND_M:
                break
            total += abs(turn.angle_deg)
            most_deg = _MOST_DEG if j == k else _MERGED_DEG
            other = j > k and claim.side not in (first.side, "around")
            told = any(c.kind == "turn" and c.side != claim.side for c in self.claims[index:])
            after = self.claims[index + 1] if index + 1 < len(self.claims) else claim
            gentle = "slight" in (claim.degree, after.degree if after.kind == "pass" else "")
            if self._weaves(j, total) and not (gentle and told):
                continue
            degrees = total
            if claim.degree == "slight" and not self._in_parts(claim, index):
                degrees = max(total, manoeuvre_deg(self.turns, first.along_m))
            if not other and _is(claim, first.side, degrees, most_deg):
                result.append(j + 1)
        return result

    def _in_parts(self, claim: Claim, index: int) -> bool:
        """Return whether another turn to the same side is claimed nearby: one bend told as two."""
        near = [*self.claims[max(0, index - 3) : index], *self.claims[index + 1 : index + 4]]
        return any(c.kind == "turn" and c.side == claim.side for c in near)

    def _weaves(self, k: int, degrees: float) -> bool:
        """Return whether a small bend that ends with turn `k` only swings out for the next one."""
        after = self.turns[k + 1] if k + 1 < len(self.turns) else None
        return (
            degrees < _WEAVE_DEG
            and after is not None
            and after.side != self.turns[k].side
            and abs(after.angle_deg) >= max(_WEAVE_DEG, 1.5 * degrees)
            and after.along_m - self.turns[k].along_m <= _ONE_BEND_M
        )

    def _leader(self, turn: TurnFact) -> int:
        """Return the number of the first claim that leads around a turn, −1 for a slight turn."""
        ground = self.ground
        last = turn.along_m > ground.length_m - _END_M
        first = turn.along_m < _START_M and abs(turn.angle_deg) < _START_DEG
        if abs(turn.angle_deg) < CLEAR_DEG or first or last:
            return -1
        doors = [p for p in ground.facts.passages if -1.0 <= p.along_m - turn.along_m <= 2.6]
        k = int(np.argmin(np.abs(self.along - (turn.along_m - 0.4))))
        straight = False  # what is named on a way that is called straight leads around no turn
        for index, claim in enumerate(self.claims):
            before = self.claims[index - 1] if index else claim
            onward = before.kind == "walk" and before.side == "ahead"
            ahead = (claim.side == "ahead" or onward) and claim.kind in _WAYS
            after = self.claims[index + 1] if index + 1 < len(self.claims) else claim
            if after.side == "ahead" and after.kind in _WAYS:
                doors = [p for p in doors if p.along_m > turn.along_m]  # "and straight on from it"
            straight = (ahead or straight) and claim.kind != "turn"
            again = claim.kind == "stop" and any(
                c.kind in ("enter", "in") and c.name == claim.name for c in self.claims[:index]
            )
            aside = (
                claim.kind in ("door", "enter", "reach")
                and claim.what != "thing"
                and claim.side in ("left", "right")
            )
            if (aside or not straight) and not again:
                if any(_goes(ground, claim, p.from_room, p.to_room) for p in doors):
                    return index
                if claim.what == "thing" and (
                    # The way around a thing bends; a thing ahead is walked up to.
                    (claim.kind == "pass" and claim.degree == "slight")
                    or (claim.kind == "stop" and ground.stop_in_view(claim)[k])
                    or (claim.kind in ("reach", "pass") and self._ahead(claim, turn, k))
                ):
                    return index
            beyond = [p for p in ground.facts.passages if p.along_m > turn.along_m + 0.3][:1]
            named = claim.kind == "enter" or (claim.kind == "door" and claim.room)
            if (
                straight
                and named
                and any(_goes(ground, claim, p.from_room, p.to_room) for p in beyond)
            ):
                break  # what is named behind that door leads around no turn before it
            straight = ahead or (straight and claim.kind not in ("enter", "door", "leave"))
        return len(self.claims)

    def _ahead(self, claim: Claim, turn: TurnFact, k: int) -> bool:
        """Return whether a thing is in view at place `k`, and passed after a turn."""
        mask, _ = self.ground.seen_at(Claim("see", "thing", claim.name, room=claim.room))
        passed_m = self.ground.abeam_m(claim) or (0.0, np.inf)
        return passed_m[1] > turn.along_m and bool(mask[k])


def _is(claim: Claim, side: str, degrees: float, most_deg: float) -> bool:
    """Return whether a bend may be called what a claim says."""
    if claim.side == "around":
        return degrees >= _AROUND_DEG
    if side != claim.side:
        return degrees >= 165.0
    if claim.degree == "slight":
        return degrees <= _GENTLE_DEG
    return degrees >= _SHARP_DEG if claim.degree == "sharp" else degrees <= most_deg


def _goes(ground: Ground, claim: Claim, from_room: str, to_room: str) -> bool:
    """Return whether a claim goes through an opening between two rooms."""
    name = claim.room if claim.what == "door" else claim.name
    sided = (
        claim.kind in ("see", "reach") and claim.what != "thing" and claim.side in ("left", "right")
    )
    if (claim.kind in ("door", "enter", "leave") or sided) and not name:
        return True
    if claim.kind not in ("enter", "leave", "in", "stop", "door") and not sided:
        return False
    names = ground.rooms(name)
    return to_room in names or (claim.kind == "leave" and from_room in names)
