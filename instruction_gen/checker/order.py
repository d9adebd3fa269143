"""Whether claims hold in their order, with no clear turn of the path left out.

A state is a number of turns made and the set of places where the walker may be after the claims
so far. Each claim moves the states on; one that leaves none is false where it stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..facts.records import TurnFact
from ..language.claims import Claim
from .ground import Ground
from .things import Mask, Place, room_names, spread

States = dict[int, Mask]

CLEAR_DEG = 62.0  # a turn of this much is claimed, or led to by what is named next
_GENTLE_DEG, _SHARP_DEG, _AROUND_DEG, _MOST_DEG = 88.0, 55.0, 125.0, 160.0
_ONE_BEND_M, _TWICE_DEG = 2.2, 95.0
_START_M, _START_DEG = 0.3, 100.0  # who starts to walk turns that way without being told
_LATE_M = 1.8  # how far beyond an unclaimed turn a claim may already lie
_ORDER_M = 1.0  # things this near to each other may be passed in either order
_SLACK_M = {"pass": 2.0, "see": 4.0, "reach": 1.5, "in": 1.0, "enter": 1.0, "leave": 1.0,
            "door": 1.2, "turn": 1.3, "stop": 9.0}  # fmt: skip


@dataclass(frozen=True)
class Problem:
    """A claim that does not hold, by its place in the list, and why."""

    index: int
    reason: str


def check_order(claims: Sequence[Claim], owners: Sequence[int], ground: Ground) -> list[Problem]:
    """Return what does not hold, in order; `owners` are the numbers of the claims' steps."""
    return _Walk(ground, claims, owners).run()


class _Walk:
    def __init__(self, ground: Ground, claims: Sequence[Claim], owners: Sequence[int]):
        self.ground, self.claims, self.owners = ground, claims, owners
        self.room: tuple[int, Claim, Mask] | None = None  # the last room that was entered
        self.along, self.turns = ground.along_m, ground.facts.turns
        start = np.zeros(len(self.along), dtype=bool)
        start[0] = True
        self.states: States = {0: start}
        self.tight: States | None = None  # after a distance: where it led
        self.last: list[Mask] = []  # where the last place that is named may be
        self.index = 0
        self.leads = [self._leads(t) for t in self.turns]  # first claim that leads around each

    def run(self) -> list[Problem]:
        """Return the problems of all claims."""
        problems: list[Problem] = []
        passed_m = -np.inf
        for index, claim in enumerate(self.claims):
            self.index = index
            if claim.kind == "stop":
                reason = self._stop(claim)
            elif claim.kind == "walk":
                reason = self._distance(claim)
            elif claim.kind == "turn":
                reason = self._turn(claim)
            elif claim.kind == "avoid":
                reason = self._avoid(claim)
            else:
                reason = self._place(claim)
                if claim.kind == "pass" and claim.what == "thing" and not reason:
                    at_m = self.ground.abeam_m(claim)
                    if at_m is not None and at_m < passed_m - _ORDER_M:
                        reason = f"the {claim.name} is passed earlier"
                    passed_m = max(passed_m, at_m or passed_m)
            if reason:
                problems.append(Problem(index, reason))
        if not problems and self.claims and (left := self._left_out()):
            problems.append(Problem(len(self.claims) - 1, left))
        return problems

    # claims -----------------------------------------------------------------------------------

    def _find(self, claim: Claim) -> Place:
        ground = self.ground
        if claim.what == "room":
            return {
                "leave": ground.left, "enter": ground.entered, "in": ground.inside,
                "reach": ground.inside, "pass": ground.room_passed, "see": ground.room_in_view,
                "door": ground.entered,
            }[claim.kind](claim)  # fmt: skip
        if claim.kind in ("door", "enter", "leave", "in"):
            return ground.through_door(claim) if claim.what == "door" else ground.left(claim)
        since = min(int(np.argmax(here)) for here in self.states.values())
        return {"pass": ground.passed, "see": ground.seen_at, "reach": ground.reached}[claim.kind](
            claim, max(0, since - 4)
        )

    def _place(self, claim: Claim) -> str:
        mask, reason = self._find(claim)
        if reason:
            return reason
        self.last = [mask]
        owner = self.owners[self.index]
        if self.room is not None and self.room[0] != owner:
            if (
                claim.kind == "door"
                and self.claims[self.index - 1] is self.room[1]
                and (self.room[1].kind == "enter" and self.room[1].name)
            ):
                mask = mask & ~self.room[2]  # "go into the hall and take the door": the next one
            elif claim.kind in ("pass", "reach") and self.room[1].name:
                first = float(self.along[np.argmax(self.room[2])])
                mask = mask & (self.along >= first + 0.5)  # not what stands in the room before
            if not mask.any():
                return f"the {claim.text or 'doorway'} is not in the room that the text has entered"
        slack, still = _SLACK_M[claim.kind], claim.kind == "see" or claim.kind == "pass"
        states = self.states
        if self.tight is not None and claim.kind in ("door", "enter", "leave"):
            near = {k: spread(m, self.along, 1.0) for k, m in self.tight.items()}
            onward = {k: m for k, m in near.items() if (m & mask).any()}
            states = onward or states  # "walk nine metres, out of the room and down the hall"
            self.tight = None
        result: States = {}
        for made, here in states.items():
            first = float(self.along[np.argmax(here)])
            reach = mask & (self.along >= first - slack) & (self.along <= self._limit(made, first))
            if not reach.any():
                continue
            ahead = reach & (self.along >= first - 0.3)
            if claim.kind == "see":
                result[made] = here
            elif still:
                result[made] = ahead if ahead.any() else here
            else:
                result[made] = ahead if ahead.any() else reach
        if result:
            self.states = result
            if claim.kind in ("enter", "door"):
                entered = np.any([mask & m for m in result.values()], axis=0)
                self.room = (owner, claim, entered) if entered.any() else self.room
            return ""
        return self._missing(claim, mask)

    def _missing(self, claim: Claim, mask: Mask) -> str:
        what = f"the {claim.text or 'doorway'}"
        first = min(float(self.along[np.argmax(m)]) for m in self.states.values())
        made = max(self.states)
        if self._limit(made, first) < self.along[np.flatnonzero(mask)[0]]:
            turn = next(t for k, t in enumerate(self.turns) if k >= made
                        and self.leads[k] > self.index and t.along_m > first - 0.5)  # fmt: skip
            return f"the turn to the {turn.side} before {what} is not mentioned"
        return f"{what} comes earlier on the path than the text says"

    def _turn(self, claim: Claim) -> str:
        result: States = {}
        for made, here in self.states.items():
            first = float(self.along[np.argmax(here)])
            limit = self._limit(made, first)
            tight = None if self.tight is None else self.tight.get(made)
            for k in range(made, len(self.turns)):
                if self.turns[k].along_m > limit or self._skips(made, k, here, claim):
                    break
                for end in self._bends(k, claim):
                    last = self.turns[end - 1].along_m
                    if last < first - _SLACK_M["turn"]:
                        continue
                    around = self.ground.between(self.turns[k].along_m - 1.2, last + 1.2)
                    if tight is not None and not (tight & around).any():
                        continue
                    at = self.ground.between(self.turns[k].along_m - 0.2, last + 0.5)
                    result[end] = result.get(end, np.zeros_like(at)) | at
            if claim.degree == "slight" and not self._mistaken(made, claim):
                other = np.zeros_like(here)
                for t in self.turns:
                    if t.side != claim.side:
                        other |= self.ground.between(t.along_m - 2.0, t.along_m + 2.0)
                if (here & ~other).any():  # a bend too slight for the facts
                    result[made] = result.get(made, np.zeros_like(here)) | (here & ~other)
            again = self._again(made, here, claim)
            if again.any():
                result[made] = result.get(made, again) | again
        if not result:
            side = "around" if claim.side == "around" else f"to the {claim.side}"
            return f"there is no turn {side} here"
        self.states, self.tight = result, None
        return ""

    def _skips(self, made: int, k: int, here: Mask, claim: Claim) -> bool:
        """Return whether an unclaimed clear turn to the other side lies before turn `k`."""
        last_m = float(self.along[here][-1])
        return any(
            t.side != claim.side and abs(t.angle_deg) >= CLEAR_DEG and t.along_m > last_m - 1.0
            for t in self.turns[made:k]
        )

    def _mistaken(self, made: int, claim: Claim) -> bool:
        """Return whether a slight bend must be a turn of the path that goes to the other side.

        It is where fewer turns to that side are claimed from here on than the path makes.
        """
        left = [t for t in self.turns[made:] if t.side != claim.side and abs(t.angle_deg) >= 28.0]
        later = [c for c in self.claims[self.index :] if c.kind == "turn" and c.side != claim.side]
        return len(left) > len(later)

    def _again(self, made: int, here: Mask, claim: Claim) -> Mask:
        """Return where one wide bend may be told as two turns to the same side."""
        if made and self.turns[made - 1].side == claim.side:
            turn = self.turns[made - 1]
            if abs(turn.angle_deg) >= _TWICE_DEG:
                return here & self.ground.between(turn.along_m - 0.3, turn.along_m + _ONE_BEND_M)
        return np.zeros_like(here)

    def _bends(self, k: int, claim: Claim) -> list[int]:
        """Return how many turns are made after a claimed turn that begins with turn `k`."""
        result, total = [], 0.0
        for j in range(k, len(self.turns)):
            turn = self.turns[j]
            if turn.side != self.turns[k].side:
                break
            if j > k and turn.along_m - self.turns[j - 1].along_m > _ONE_BEND_M:
                break
            total += abs(turn.angle_deg)
            if self._is(claim, self.turns[k].side, total) and (j == k or total <= _MOST_DEG):
                result.append(j + 1)
        return result

    @staticmethod
    def _is(claim: Claim, side: str, degrees: float) -> bool:
        if claim.side == "around":
            return degrees >= _AROUND_DEG
        if side != claim.side:
            return degrees >= 165.0
        if claim.degree == "slight":
            return degrees <= _GENTLE_DEG
        return degrees >= _SHARP_DEG if claim.degree == "sharp" else degrees <= 200.0

    def _distance(self, claim: Claim) -> str:
        d = claim.metres
        low, high = (0.2, max(6.0, 2 * d)) if claim.vague else (0.7 * d - 0.6, 1.35 * d + 0.8)
        result: States = {}
        for made, here in self.states.items():
            far = np.zeros_like(here)
            for at in self.along[here]:
                far |= self.ground.between(at + low, at + high)
            far &= self.along <= self._limit(made, float(self.along[np.argmax(here)]))
            if far.any():
                result[made] = far
        if not result:
            return f"the path does not go on for {d:g} metres"
        self.tight = result
        return ""

    def _avoid(self, claim: Claim) -> str:
        names = room_names(claim.name)
        first = min(float(self.along[np.argmax(m)]) for m in self.states.values())
        later = [v for v in self.ground.facts.visits if v.room in names and v.from_m > first + 0.5]
        twins = self.ground.facts.level_rooms.count(claim.name) > 1
        return f"the path does enter the {claim.name}" if later and not twins else ""

    def _stop(self, claim: Claim) -> str:
        ground = self.ground
        if claim.what == "room":
            reason = ground.stopped_in(claim)
        elif claim.what == "door":
            reason = ground.stopped_at_door(claim)
        else:
            reason = ground.stopped_at(claim) if claim.what == "thing" else ""
        if reason := reason or self._elsewhere(claim):
            return reason
        end = ground.between(ground.length_m - 0.5, ground.length_m)
        if self.tight is not None and not any(
            (spread(m, self.along, 1.2) & end).any() for m in self.tight.values()
        ):
            return "the path goes on farther than the distance before the stop"
        self.tight = None
        named = [*self.states.values(), *self.last]
        if not claim.what and not any((spread(m, self.along, 3.0) & end).any() for m in named):
            return "the path goes on farther than what is named before the stop"
        return ""

    def _elsewhere(self, claim: Claim) -> str:
        """Return why a thing to stop at must be one in a room that the path only goes through."""
        since = min(int(np.median(np.flatnonzero(here))) for here in self.states.values())
        if claim.what == "thing" and not claim.room and self.ground.met_before_end(claim, since):
            return f"the first {claim.name} on the way is not where the path ends"
        return ""

    # turns that are not claimed ---------------------------------------------------------------

    def _limit(self, made: int, first_m: float) -> float:
        """Return how far the walker gets before a turn that should have been claimed [m]."""
        for k, turn in enumerate(self.turns):
            if k >= made and self.leads[k] > self.index and turn.along_m > first_m - 0.5:
                return turn.along_m + _LATE_M
        return np.inf

    def _left_out(self) -> str:
        for made, here in self.states.items():
            if not np.isfinite(self._limit(made, float(self.along[here][-1]) - 0.5)):
                return ""
        made = max(self.states)
        turn = next(t for k, t in enumerate(self.turns) if k >= made and self.leads[k] > self.index)
        return f"the turn to the {turn.side} is not mentioned"

    def _leads(self, turn: TurnFact) -> int:
        """Return the number of the first claim that leads around a turn, −1 for a slight turn."""
        ground = self.ground
        last = turn.along_m > ground.length_m - 0.9
        first = turn.along_m < _START_M and abs(turn.angle_deg) < _START_DEG
        if abs(turn.angle_deg) < CLEAR_DEG or first or last:
            return -1
        doors = [p for p in ground.facts.passages if -1.6 <= p.along_m - turn.along_m <= 2.6]
        k = int(np.argmin(np.abs(self.along - (turn.along_m - 0.4))))
        for index, claim in enumerate(self.claims):
            if any(self._names(claim, p.from_room, p.to_room) for p in doors):
                return index
            if claim.what != "thing":
                continue
            if claim.kind == "pass" and claim.degree == "slight":
                return index  # the way around a thing bends
            if claim.kind == "stop" and ground.stop_in_view(claim)[k]:
                return index
            if claim.kind in ("reach", "pass"):
                mask, reason = ground.seen_at(Claim("see", "thing", claim.name, room=claim.room))
                ahead = (ground.abeam_m(claim) or ground.length_m) > turn.along_m
                if not reason and ahead and mask[k]:
                    return index
        return len(self.claims)

    @staticmethod
    def _names(claim: Claim, from_room: str, to_room: str) -> bool:
        if claim.kind in ("door", "enter", "leave") and not (claim.room or claim.name):
            return True
        if claim.kind not in ("enter", "leave", "in", "stop", "door"):
            return False
        names = room_names(claim.room if claim.what == "door" else claim.name)
        return bool(names & {to_room}) or (claim.kind == "leave" and from_room in names)
