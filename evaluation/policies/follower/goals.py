"""A text as sub-goals."""

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Part:
    """What a text says of one level.

    Attributes:
        goals: the stop last; where stairs are taken then, it is at them.
        way: `up` or `down` the stairs at its end; empty of the last part.
    """

    goals: tuple[SubGoal, ...]
    way: str = ""


def parts_of(steps: Sequence[Step]) -> tuple[Part, ...]:
    """Return the parts of a text, one more than it takes stairs.

    Raises:
        UnfollowableError: it never says where to stop, or goes on after that.
    """
    claims = [(claim, step.words) for step in steps for claim in step.claims]
    stops = [(c, words) for c, words in claims if c.kind == "stop"]
    if not stops:
        raise UnfollowableError("the text never says to stop")
    if any("goes on after the stop" in fault for step in steps for fault in step.faults):
        raise UnfollowableError("the text goes on after the stop")
    parts: list[Part] = []
    moves: list[SubGoal] = []
    for step in steps:
        on_stairs = bool(parts) and not moves and _is_of_stairs(step)
        for claim in step.claims:
            if claim.kind == "climb":
                if moves or not parts or parts[-1].way != claim.way:
                    noun = Place("object", "stairs", "at", _side(claim))
                    stairs = SubGoal("stop", step.words, noun=noun, verb="stop")
                    parts.append(Part((*moves, stairs), claim.way))
                    moves = []
            elif not on_stairs and (goal := _move(claim, step.words)) is not None:
                moves.append(goal)
    named = [SubGoal("stop", words, noun=_place(c), verb="stop") for c, words in stops
             if c.what not in ("", "storey")]  # fmt: skip
    return (*parts, Part((*moves, *(named or [SubGoal("stop", stops[-1][1])]))))


def _is_of_stairs(step: Step) -> bool:
    """Return whether a step after a climb tells of its landing or its end, not of a level."""
    return any(
        (c.name == "landing" and c.kind in ("see", "reach", "in"))
        or (c.kind == "reach" and c.place in ("top", "bottom", "halfway"))
        for c in step.claims
    )


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
    prep = "past" if claim.place == "past" else _PREPS[claim.kind]
    return Place(
        kind, "door" if kind == "door" else claim.name, prep, _side(claim), max(claim.ordinal, 0)
    )


def _side(claim: Claim) -> str:
    return claim.side if claim.side in ("left", "right") else ""
