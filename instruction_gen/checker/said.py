"""What stands around a claim in its text."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..language.claims import Claim, Step
from ..language.tokens import tokenize
from ..language.words import VERB_OF

WAYS = ("walk", "in", "door", "leave", "enter")
_NOTHING = Claim("walk")
_BY_THE_WAY = ("see", "in", "pass", "reach")
_FEW_STEPS_M = 3.0


@dataclass(frozen=True)
class Said:
    """A claim in its text.

    Attributes:
        claims: of the text.
        owners: the numbers of their steps.
        index: of the claim.
    """

    claims: Sequence[Claim]
    owners: Sequence[int]
    index: int

    @property
    def claim(self) -> Claim:
        """The claim itself."""
        return self.claims[self.index]

    @property
    def before(self) -> Sequence[Claim]:
        """The claims before it, the last one first."""
        return self.claims[: self.index][::-1]

    @property
    def last(self) -> Claim:
        """The claim before it."""
        return self.claims[self.index - 1] if self.index else _NOTHING

    @property
    def following(self) -> Claim:
        """The claim after it."""
        return self.claims[self.index + 1] if self.index + 1 < len(self.claims) else _NOTHING

    @property
    def apart(self) -> bool:
        """Whether the claim before belongs to another step."""
        return self.index > 0 and self.owners[self.index - 1] != self.owners[self.index]

    @property
    def stopped(self) -> bool:
        """Whether the text has stopped before."""
        return any(claim.kind == "stop" for claim in self.before)

    @property
    def moved(self) -> bool:
        """Whether the text has moved before."""
        kinds = ("enter", "door", "leave", "in", "turn", "climb", "reach")
        return any(c.kind in kinds for c in self.before)

    @property
    def on_landing(self) -> bool:
        """Whether the claim before is halfway up stairs, or of a landing after or beside it."""
        climbed = any(c.kind == "climb" for c in self.before[1:2])
        landing = self.last.name == "landing" and (climbed or not self.apart)
        return landing or self.last.place == "halfway"

    @property
    def off_stairs(self) -> bool:
        """Whether the claim before is at an end of stairs, or in a room after stairs."""
        climbed = any(claim.kind == "climb" for claim in self.before)
        room = self.last.what == "room" and self.last.name != "landing"
        return self.last.place in ("top", "bottom") or (climbed and room)

    @property
    def climbs_next(self) -> bool:
        """Whether stairs are taken before any room is entered or door gone through."""
        moves = ("climb", "enter", "door", "leave")
        then = (c.kind for c in self.claims[self.index + 1 :])
        return next((kind for kind in then if kind in moves), "") == "climb"

    @property
    def paced_m(self) -> float:
        """The distance that leads to the claim, 0 where none does [m]."""
        kinds = ("see", "pass", "in", "stop")
        last = next((c for c in self.before if c.kind not in kinds), _NOTHING)
        return (last.metres or _FEW_STEPS_M * last.vague) if last.kind == "walk" else 0.0

    @property
    def led_to(self) -> Claim:
        """What the step does before."""
        for k in range(self.index - 1, -1, -1):
            if self.owners[k] != self.owners[self.index]:
                break
            if self.claims[k].kind not in ("leave", "see", "pass"):
                return self.claims[k]
        return _NOTHING

    @property
    def turned(self) -> bool:
        """Whether a turn of the same step says the claim's side, or one before it what is ahead."""
        step, ahead = self.owners[self.index], self.claim.side == "ahead"
        return (ahead and self.neighbours[0].kind == "turn") or any(
            owner == step and (claim.kind, claim.side) == ("turn", self.claim.side)
            for claim, owner in zip(self.claims, self.owners, strict=True)
        )

    @property
    def neighbours(self) -> tuple[Claim, Claim]:
        """The claims before and after it that say which way the walker goes."""
        then = self.claims[self.index + 1 :]
        since, onward = (
            next((c for c in row if _leads(c)), _NOTHING) for row in (self.before, then)
        )
        return since, onward

    @property
    def straight(self) -> bool:
        """Whether the way to the claim is called straight."""
        recent = self.claims[max(self.index - 2, 0) : self.index + 1]
        return any(claim.side == "ahead" and claim.kind in WAYS for claim in recent)

    @property
    def is_pair(self) -> bool:
        """Whether the claim is the second of two things that one is between."""
        claim, row = self.claim, 0
        for before in self.before:
            if before.place != "between" or (before.kind, before.what) != (claim.kind, "thing"):
                break
            row += 1
        return claim.place == "between" and row % 2 == 1


def _leads(claim: Claim) -> bool:
    told = claim.kind not in (*_BY_THE_WAY, "walk")
    return told or (claim.side == "ahead" and claim.kind in WAYS)


def goal_last(steps: Sequence[Step]) -> tuple[Step, ...]:
    """Return the steps with what a first one says of the goal alone at the stop that they end in.

    "Your destination is the kitchen" comes before the way.
    """
    stops = [k for k, step in enumerate(steps) if any(c.kind == "stop" for c in step.claims)]
    if len(stops) < 2 or stops[0] or any(c.kind != "stop" for c in steps[0].claims):
        return tuple(steps)
    if VERB_OF.get(tokenize(steps[0].words)[0].text) == "stop":  # "Stop at the table. Then …"
        return tuple(steps)
    goal, last = steps[0].claims, steps[stops[-1]]
    last = replace(last, claims=(*last.claims, *goal))
    first = replace(steps[0], claims=())
    return (first, *steps[1 : stops[-1]], last, *steps[stops[-1] + 1 :])
