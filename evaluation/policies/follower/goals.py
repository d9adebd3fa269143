"""A text as sub-goals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ....instruction_gen.language.claims import Claim, Step
from ....instruction_gen.language.stairs import is_stairs


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
EITHER, LANDING = "either", "landing"
_VERBS = {"door": "enter", "in": "move"}


@dataclass(frozen=True)
class Part:
    """What a text says of one level.

    Attributes:
        goals: the stop last; where stairs are taken then, it is at them.
        way: `up` or `down` the stairs at its end, `either` where the text does not say; empty of
            the last part.
    """

    goals: tuple[SubGoal, ...]
    way: str = ""


def parts_of(steps: Sequence[Step]) -> tuple[Part, ...]:
    """Return the parts of a text, one more than it takes stairs.

    A staircase is taken with all its flights. One that is taken the same way again is another
    only if the text names a place of a level before it; turns alone are on a landing.

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
    on_stairs = on_storey = False
    for step in steps:
        on_landing = any(_is_of_landing(claim) for claim in step.claims)
        for claim in step.claims:
            if claim.kind == "climb":
                way = claim.way or EITHER
                if on_stairs and (way == parts[-1].way or EITHER in (way, parts[-1].way)):
                    known = way if parts[-1].way == EITHER else parts[-1].way
                    parts[-1] = replace(parts[-1], way=known)
                else:
                    noun = Place("object", "stairs", "at", _side(claim))
                    stairs = SubGoal("stop", step.words, noun=noun, verb="stop")
                    parts.append(Part((*moves, stairs), way))
                moves, on_stairs, on_storey = [], True, False
            elif on_stairs and claim.kind == "reach" and claim.place in ("top", "bottom"):
                moves = []  # what was said before is of the landing
            elif on_stairs and not moves and _is_of_stairs(claim, on_landing):
                continue
            elif (goal := _move(claim, step.words)) is not None:
                moves.append(goal)
                on_level = goal.noun is not None and goal.noun.head != LANDING
                on_stairs = on_stairs and not on_level and not on_storey
            on_storey = on_storey or (claim.what == "storey" and claim.kind == "in")
    named = [SubGoal("stop", words, noun=_place(c), verb="stop") for c, words in stops
             if c.what not in ("", "storey")]  # fmt: skip
    return (*parts, Part((*moves, *(named or [SubGoal("stop", stops[-1][1])]))))


def _is_of_landing(claim: Claim) -> bool:
    """Return whether a claim after a climb is of the middle of the staircase, not of a level."""
    return claim.kind != "stop" and (
        claim.name == LANDING or (claim.kind == "reach" and claim.place == "halfway")
    )


def _is_of_stairs(claim: Claim, on_landing: bool) -> bool:
    """Return whether the first claims after a climb are of the staircase, as its landing is."""
    told_there = on_landing and claim.kind in ("turn", "walk", "see")
    return told_there or is_stairs(claim) or _is_of_landing(claim)


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
