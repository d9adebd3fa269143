"""A text as sub-goals."""

from dataclasses import dataclass

from ..language.announced import readings
from ..language.clauses import Clause, Noun, Parse
from ..language.ending import last_stop

_AT = frozenset(("at", "near", "before", "past", "after", "in", "with", ""))
_MOVING = frozenset(("turn", "move", "enter", "leave", "pass"))


@dataclass(frozen=True)
class SubGoal:
    """One thing to do or to come by.

    Attributes:
        kind: `turn`, `walk`, `place`, `see` or `stop`.
        said: the words of its clause.
        side, degree: of a turn, see `language.clauses.Clause`.
        distance_m: of a walk [m].
        vague: the distance is `a few metres` or the like.
        noun: of a place, None of a stop where one is.
        verb: of its clause.
    """

    kind: str
    said: str
    side: str = ""
    degree: str = ""
    distance_m: float = 0.0
    vague: bool = False
    noun: Noun | None = None
    verb: str = ""


class UnfollowableError(ValueError):
    """A text gives no sub-goals to end with; the message says why."""


def sub_goals(read: Parse) -> list[SubGoal]:
    """Return the sub-goals of a text, the stop last.

    Raises:
        UnfollowableError: it never says where to stop, or goes on after that.
    """
    read = next((r for r in readings(read) if last_stop(r) is not None), read)
    stop = last_stop(read)
    if stop is None:
        raise UnfollowableError("the text never says to stop")
    result: list[SubGoal] = []
    for index, clause in enumerate(read.clauses[:stop]):
        if not clause.negated:
            result += _moves(clause, _said(read, index))
    said = _said(read, stop)
    clause = read.clauses[stop]
    if clause.distance_m:
        result.append(_walk(clause, said))
    places = list(clause.nouns)
    for after in read.clauses[stop + 1 :]:
        if after.verb in _MOVING and not (after.until or after.before or after.meanwhile):
            raise UnfollowableError("the text goes on after the stop")
        places += after.nouns
    named = [SubGoal("stop", said, noun=n, verb=clause.verb) for n in places]
    return [*result, *named] if named else [*result, SubGoal("stop", said)]


def _moves(clause: Clause, said: str) -> list[SubGoal]:
    def place(noun: Noun) -> SubGoal:
        seen = clause.verb == "see" or noun.prep == "with" or clause.before or clause.meanwhile
        return SubGoal("see" if seen else "place", said, noun=noun, verb=clause.verb)

    if clause.verb == "turn" or clause.side:
        first = [place(n) for n in clause.nouns if n.prep in _AT or n.prep == "from"]
        then = [place(n) for n in clause.nouns if n.prep not in _AT and n.prep != "from"]
        turn = SubGoal("turn", said, side=clause.side, degree=clause.degree)
        walk = [_walk(clause, said)] if clause.distance_m else []
        return [*first, turn, *walk, *then]
    walk = [_walk(clause, said)] if clause.distance_m else []
    return [*walk, *(place(n) for n in clause.nouns)]


def _walk(clause: Clause, said: str) -> SubGoal:
    return SubGoal("walk", said, distance_m=clause.distance_m, vague=clause.vague)


def _said(read: Parse, index: int) -> str:
    clause = read.clauses[index]
    return read.text[clause.start : clause.stop].strip(" ,.")
