"""Whether claims hold in the order of the text, with no turn of the path left out.

Dynamic programming over places of the path and turns made: a state is the set of places where
one may be after the claims so far and a number of turns. Each claim moves the states on; one
that leaves none is false where it stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..language.lexicon import DOORS
from .claim import Claim
from .ground import Ground, Mask, spread
from .implied import IMPLIED_M, SPOT_M, Implied

_AROUND_DEG = 125.0
_LATE_M = 1.6  # how far beyond an unmentioned turn a claim may already lie
_ONE_BEND_M = 2.0
_U_TURN_M = 3.0
_ONE_TURN_DEG = 130.0  # more than this, not on the spot, is two turns
_TWO_TURNS_DEG = 100.0  # this much within a bend may be told as two turns
_TURNED_M = 0.5  # what follows a turn lies no farther before it
_GENTLE_M = 2.5  # a bend that the facts do not have is told this far from a turn to elsewhere
_BENT_DEG = 60.0  # a bend of this much may be told as a turn that goes on to that side
_BARE_STOP_M = 2.6
_ORDER_M = 1.5  # things passed this near to each other may be mentioned in either order
_MEANWHILE_M = 4.0
_COME_M = 0.9  # who comes through a door is about to be in the room behind it
# How strong contradictions are; see `Contradiction`.
_LOOSE = 0.5
_OUT_OF_ORDER_M = 3.0  # a thing passed this much out of order
_CLEAR_DEG = 75.0  # texts always mention a turn of this much
_DOOR_AFTER_M = 2.2  # unless a door is behind it that was told with its side
_DOORS = frozenset(f"the {door}" for door in DOORS)


States = dict[int, Mask]


@dataclass(frozen=True)
class Contradiction:
    """What does not hold.

    Attributes:
        clause: index of its clause.
        strength: 1 = no reading of the clause holds; less where the words are vague or the facts
            are within what a person may overlook.
    """

    clause: int
    reason: str
    strength: float


def align(claims: Sequence[Claim], ground: Ground) -> list[Contradiction]:
    """Return what does not hold, in order."""
    return _Aligner(ground).run(claims)


class _Aligner:
    def __init__(self, ground: Ground):
        self.ground = ground
        self.along = ground.along_m
        self.turns = ground.facts.turns
        self.implied = Implied(ground)
        start = np.zeros(len(self.along), dtype=bool)
        start[0] = True
        self.states: States = {0: start}
        self.through = -1  # the last clause that led through a door
        self.entered = False  # the claim before led through a door
        self.doors: set[str] = set()  # sides on which the text says that doors are
        self.tight: States | None = None  # after a distance: where it must have led

    def run(self, claims: Sequence[Claim]) -> list[Contradiction]:
        problems: list[Contradiction] = []
        self.doors = {c.side for c in claims if c.kind == "door" or c.reason in _DOORS}
        passed_m = 0.0
        for claim in claims:
            if claim.kind == "false":
                problems.append(Contradiction(claim.clause, claim.reason, claim.strength))
                continue
            if claim.abeam_m is not None:
                if claim.abeam_m < passed_m - _ORDER_M:
                    reason = f"{claim.reason} is passed earlier"
                    strength = min(1.0, (passed_m - claim.abeam_m) / _OUT_OF_ORDER_M)
                    problems.append(Contradiction(claim.clause, reason, strength))
                    continue
                passed_m = claim.abeam_m
            after = self._step(claim)
            if claim.maybe:
                self.states = _either(self.states, after)
            elif after:
                self.states = after
            elif not claim.optional:
                strength = self._strength(claim)
                problems.append(Contradiction(claim.clause, self._why(claim), strength))
            self.entered = claim.kind == "door" and bool(after)
            if after and claim.kind in ("door", "exit"):
                self.through = claim.clause
        if not problems:
            left = self._left_out()
            if left is not None:
                last = claims[-1].clause if claims else 0
                problems.append(Contradiction(last, self._skipped(left), self._untold(left)))
        return problems

    # steps ------------------------------------------------------------------------------------

    def _step(self, claim: Claim) -> States:
        if claim.kind == "walk":
            return self._walk(claim)
        if claim.kind == "turn":
            after = self._turn(claim)
        elif claim.kind == "stop":
            after = self._stop(claim)
        else:
            after = self._place(claim)
        if not after and self.tight is not None and claim.kind in ("door", "exit"):
            # "Walk nine metres: out of the room and down the hall": that is on the way.
            tight, self.tight = self.tight, None
            after, self.tight = self._place(claim), tight
            return after
        if after and (claim.kind in ("turn", "stop", "door", "exit")):
            self.tight = None
        return after

    def _walk(self, claim: Claim) -> States:
        d = claim.distance_m
        low, high = (0.2, max(6.0, 2 * d)) if claim.vague else (0.7 * d - 0.6, 1.35 * d + 0.8)
        step = self.along[1]
        result: States = {}
        for made, mask in self.states.items():
            far = np.zeros_like(mask)
            for k in np.flatnonzero(mask):
                a, b = self.along[k] + low, self.along[k] + high
                far |= (self.along >= a - step / 2) & (self.along <= b + step / 2)
            far &= self.along <= self.implied.limit(made) + _LATE_M
            if far.any():
                result[made] = far
        if not result:
            return {}
        self.tight = result
        return self.states

    def _place(self, claim: Claim) -> States:
        result: States = {}
        for made, mask in self._from(claim).items():
            slack = max(claim.slack_m, _MEANWHILE_M) if claim.still else claim.slack_m
            first = float(self.along[np.argmax(mask)]) - slack
            if made:
                first = max(first, self.turns[made - 1].along_m - _TURNED_M)
            for k in self.implied.after(made, claim):
                here = claim.mask & (self.along >= first)
                # "Turn left into the kitchen": no other turn lies between.
                late_m = SPOT_M if claim.turned else _LATE_M
                here &= self.along <= self.implied.limit(k) + late_m
                led = self.implied.led(made, claim)
                if made < k <= led:
                    here &= self.along >= self.turns[k - 1].along_m - SPOT_M
                if k > led and not (claim.bends or self.implied.leads_out(made, k, claim)):
                    turn = self.turns[k - 1]
                    here &= np.abs(self.along - turn.along_m) <= IMPLIED_M + 1.0
                if claim.still and here.any() and k == made:
                    # What is only seen, or passed meanwhile, does not move the walker back.
                    last = float(self.along[mask][-1])
                    ahead = here & (self.along >= first + slack) & (self.along <= last + slack)
                    earlier = here & (self.along >= first) & (self.along <= first + slack)
                    here = (
                        (here & mask)
                        if (here & mask).any()
                        else ahead
                        if ahead.any()
                        else (mask if earlier.any() else earlier)
                    )
                if here.any():
                    result[k] = result.get(k, np.zeros_like(here)) | here
        return result

    def _turn(self, claim: Claim) -> States:
        result: States = {}
        for made, mask in self._from(claim).items():
            slack_m = min(claim.slack_m, SPOT_M) if self.entered else claim.slack_m
            first = float(self.along[np.argmax(mask)]) - slack_m
            if claim.degree == "slight" and (gentle := self._gentle(made, mask, claim)).any():
                result[made] = gentle
            if (again := self._again(made, mask, claim)).any():
                result[made] = again
            for k in range(made, len(self.turns)):
                if k > self.implied.led(made, claim) and any(self.implied.required[made:k]):
                    break
                for used in self._fits(k, claim):
                    turn = self.turns[k]
                    last = self.turns[used - 1]
                    around = self.implied.between(turn.along_m - 0.9, last.along_m + 0.9)
                    if last.along_m < first or not (claim.mask & around).any():
                        continue
                    if self.tight is not None:
                        led = spread(self.tight.get(made, mask), self.along, 0.6)
                        if not (led & self.implied.between(turn.along_m, turn.along_m)).any():
                            continue
                    here = self.implied.between(turn.along_m - 0.2, last.along_m + 0.5)
                    result[used] = result.get(used, np.zeros_like(here)) | here
        return result

    def _gentle(self, made: int, mask: Mask, claim: Claim) -> Mask:
        """Return where a bend may be that is too slight for the facts: not at a turn elsewhere."""
        other = np.zeros_like(mask)
        for turn in self.turns[made:]:
            if turn.side != claim.side:
                other |= self.implied.between(turn.along_m - _GENTLE_M, turn.along_m + _GENTLE_M)
        return mask & claim.mask & ~other

    def _again(self, made: int, mask: Mask, claim: Claim) -> Mask:
        """Return where one wide bend may be told as two turns to the same side."""
        nowhere = np.zeros_like(mask)
        if not made or self.turns[made - 1].side != claim.side:
            return nowhere
        turn = self.turns[made - 1]
        here = self.implied.between(turn.along_m - 0.9, turn.along_m + 0.9)
        least_deg = _BENT_DEG if claim.degree in ("slight", "some") else _TWO_TURNS_DEG
        if abs(turn.angle_deg) < least_deg or not (claim.mask & here).any():
            return nowhere
        return mask & self.implied.between(turn.along_m - 0.2, turn.along_m + _ONE_BEND_M)

    def _fits(self, k: int, claim: Claim) -> list[int]:
        """Return how many turns are made after a claimed turn that begins with turn `k`."""
        found = []
        total = 0.0
        for j in range(k, len(self.turns)):
            turn = self.turns[j]
            if j > k and (
                turn.side != self.turns[k].side
                or turn.along_m - self.turns[j - 1].along_m
                > (_U_TURN_M if claim.side == "around" else _ONE_BEND_M)
            ):
                break
            total += abs(turn.angle_deg)
            apart = j > k and turn.along_m - self.turns[j - 1].along_m > SPOT_M
            whole = claim.side == "around" or claim.degree == "sharp"
            if apart and total > _ONE_TURN_DEG and not whole:
                break  # a turn and the next one
            if self._is(claim, self.turns[k].side, total):
                found.append(j + 1)
        return found

    @staticmethod
    def _is(claim: Claim, side: str, degrees: float) -> bool:
        if claim.side == "around":
            return degrees >= _AROUND_DEG
        if claim.side and side != claim.side:
            return degrees >= 165.0
        if claim.degree == "slight":
            return degrees <= 85.0
        if claim.degree == "sharp":
            return degrees >= 55.0
        return degrees <= 179.0

    def _stop(self, claim: Claim) -> States:
        result: States = {}
        for made, mask in self._from(claim).items():
            led = max(made, self.implied.led(made, claim))
            if self.implied.following(led) is not None:
                continue
            here = claim.mask & (self.along <= self.implied.limit(led) + _LATE_M)
            if claim.bare:
                near = self.tight.get(made, mask) if self.tight is not None else mask
                here &= spread(near, self.along, _BARE_STOP_M)
            elif self.tight is not None:
                here &= spread(self.tight.get(made, mask), self.along, 1.6)
            if here.any():
                result[led] = here
        return result

    def _from(self, claim: Claim) -> States:
        if self.tight is None or claim.kind == "place":
            return self.states
        if claim.kind in ("turn", "stop"):
            return self.states
        return {k: spread(m, self.along, 0.6) for k, m in self.tight.items()}

    def _left_out(self) -> int | None:
        left = [self.implied.following(made) for made in sorted(self.states)]
        return None if None in left else left[-1]

    # reasons ----------------------------------------------------------------------------------

    def _strength(self, claim: Claim) -> float:
        """Return how strong a contradiction is that a claim holds nowhere after those before it."""
        made = max(self.states)
        following = self.implied.following(made)
        if claim.kind == "turn":
            # Who only bears to a side may do so within the 20 degrees that the facts leave out.
            against = any(t.side != claim.side for t in self.turns[made:])
            slight = claim.degree in ("slight", "some")
            return _LOOSE if slight and not against else 1.0
        if claim.kind == "walk":
            return 1.0
        if claim.kind == "stop":
            return 1.0 if following is None else self._untold(following)
        if following is not None and not self._reachable(claim, made):
            return self._untold(following)
        if claim.kind in ("door", "exit"):
            return _LOOSE
        first_m = min(float(self.along[np.argmax(mask)]) for mask in self.states.values())
        before = self.along[claim.mask & (self.along <= first_m)]
        if not len(before):
            return _LOOSE
        # What was passed in the room before is not in this: "the door past the sofa" is.
        elsewhere = any(before[-1] < p < first_m + _COME_M for p in self.ground.passages_m)
        if elsewhere and self.through != claim.clause:
            return 1.0
        return min(1.0, (first_m - float(before[-1])) / _OUT_OF_ORDER_M)

    def _untold(self, k: int) -> float:
        """Return how strong a contradiction it is that turn `k` is not told."""
        turn = self.turns[k]
        through = any(0 <= p - turn.along_m <= _DOOR_AFTER_M for p in self.ground.passages_m)
        # "There is a door on the left. Pop in there."
        by_door = through and turn.side in self.doors
        return 1.0 if abs(turn.angle_deg) >= _CLEAR_DEG and not by_door else _LOOSE

    def _why(self, claim: Claim) -> str:
        made = max(self.states)
        following = self.implied.following(made)
        if claim.kind == "turn":
            if following is not None and self.turns[following].side != claim.side:
                return f"the path does not turn {claim.side} here: {self._skipped(following)}"
            return f"the path does not turn {claim.side} here"
        if claim.kind == "walk":
            return f"{claim.distance_m:.1f} m is not how far it is"
        if claim.kind == "stop":
            if following is not None:
                return self._skipped(following)
            if claim.bare:
                return "the text does not say where to stop"
            return "that is not where the path ends"
        if following is not None and not self._reachable(claim, made):
            skipped = self._skipped(following)
            return f"{claim.reason} comes after a turn that is not mentioned: {skipped}"
        return f"{claim.reason} is not in the order of the path"

    def _reachable(self, claim: Claim, made: int) -> bool:
        return bool((claim.mask & (self.along <= self.implied.limit(made) + _LATE_M)).any())

    def _skipped(self, k: int) -> str:
        turn = self.turns[k]
        return f"the turn {turn.side} after {turn.along_m:.1f} m is left out"


def _either(first: States, second: States) -> States:
    """Return the union of two sets of states."""
    result = dict(first)
    for made, mask in second.items():
        result[made] = result[made] | mask if made in result else mask
    return result
