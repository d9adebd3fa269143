"""A text as sub-goals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ....instruction_gen.language.claims import Claim, Step


@dataclass(frozen=True)
class Place:
    """The place that a sub-goal names.

    Attributes:
        kind: `object`, `room`, `door`, or `any` room.
        head: its phrase in the singular.
        side, ordinal: see `language.claims.Claim`.
        prep: how the walker comes by it: `past`, `at`, `into`, `from`, `in`, `through`, `with`.
    """

    kind: str
    head: str
    prep: str
    side: str = ""
    ordinal: int = 0


@dataclass(frozen=True)
class SubGoal:
    """One thing to do or to come by.

    Attributes:
        kind: `turn`, `walk`, `place`, `see` or `stop`.
        said: the words of its step.
        side, degree: of a turn, see `language.claims.Claim`.
        distance_m: of a walk [m].
        vague: the distance is `a few metres` or the like.
        noun: of a place, None of a stop where one is.
        verb: what the walker does there: `pass`, `enter`, `leave`, `reach`, `see` or `stop`.
    """

    kind: str
    said: str
    side: str = ""
    degree: str = ""
    distance_m: float = 0.0
    vague: bool = False
    noun: Place | None = None
    verb: str = ""


class UnfollowableError(ValueError):
    """A text gives no sub-goals to end with; the message says why."""


_PREPS = {
    "leave": "from", "enter": "into", "in": "in", "door": "through", "pass": "past",
    "see": "with", "reach": "at", "stop": "at",
}  # fmt: skip
_VERBS = {"door": "enter", "in": "move"}


def sub_goals(steps: Sequence[Step]) -> list[SubGoal]:
    """Return the sub-goals of a text, the stop last.

    The map is that of one level: of a text that takes stairs, they lead to the stairs.

    Raises:
        UnfollowableError: it never says where to stop, or goes on after that.
    """
    claims = [(claim, step.words) for step in steps for claim in step.claims]
    stops = [(c, words) for c, words in claims if c.kind == "stop"]
    if not stops:
        raise UnfollowableError("the text never says to stop")
    if any("goes on after the stop" in fault for step in steps for fault in step.faults):
        raise UnfollowableError("the text goes on after the stop")
    climb = next((k for k, (c, _) in enumerate(claims) if c.kind == "climb"), len(claims))
    stops = [(replace(c, kind="stop", what="thing", name="stairs", place="at"), words)
             for c, words in claims[climb : climb + 1]] or stops  # fmt: skip
    moves = [goal for c, words in claims[:climb] if (goal := _move(c, words)) is not None]
    named = [SubGoal("stop", words, noun=_place(c), verb="stop") for c, words in stops
             if c.what not in ("", "storey")]  # fmt: skip
    return [*moves, *(named or [SubGoal("stop", stops[-1][1])])]


def _move(claim: Claim, words: str) -> SubGoal | None:
    if claim.kind in ("stop", "avoid") or claim.what == "storey":
        return None
    if claim.kind == "turn":
        return SubGoal("turn", words, side=claim.side, degree=claim.degree or "some")
    if claim.kind == "walk":
        return SubGoal("walk", words, distance_m=claim.metres, vague=claim.vague)
    kind = "see" if claim.kind == "see" else "place"
    return SubGoal(kind, words, noun=_place(claim), verb=_VERBS.get(claim.kind, claim.kind))


def _place(claim: Claim) -> Place:
    kind = {"thing": "object", "room": "room"}.get(claim.what, "door")
    if claim.what == "room" and (claim.place in ("outside", "before") or not claim.name):
        kind = "door" if claim.place else "any"
    side = claim.side if claim.side in ("left", "right") else ""
    prep = "past" if claim.place == "past" else _PREPS[claim.kind]
    return Place(kind, "door" if kind == "door" else claim.name, prep, side, max(claim.ordinal, 0))
