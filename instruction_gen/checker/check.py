"""The verdict on a text."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..facts.records import PathFacts
from ..language.announced import readings
from ..language.asides import with_asides
from ..language.clauses import Parse
from ..language.ending import last_stop
from ..language.parse import parse
from .align import Contradiction, align
from .claims import claims_of
from .form import form_problems
from .ground import Ground

REFUSED = 1.0  # contradictions that are together as strong as this refuse a text


@dataclass(frozen=True)
class Verdict:
    """What is wrong with a text.

    Attributes:
        problems: one line each; empty when every claim holds.
        clauses: (start, stop, problems) of each clause, in characters of the text.
        unchecked: the share of words in clauses that make no claim: what is not understood is not
            refused, but counted here.
    """

    problems: tuple[str, ...]
    clauses: tuple[tuple[int, int, tuple[str, ...]], ...] = ()
    unchecked: float = 0.0

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def check_text(text: str, facts: PathFacts | Ground) -> Verdict:
    """Check a text against the facts of its path.

    Args:
        text: an instruction in English.
        facts: of its path; build a `Ground` once to check several texts.
    """
    ground = facts if isinstance(facts, Ground) else Ground(facts)
    read = parse(text)
    problems = form_problems(read)
    if problems:
        return Verdict(tuple(problems), _spans(read, []))
    meant = readings(read)
    meant += [other for one in meant if (other := with_asides(one)) is not None]
    verdicts = [_verdict(reading, ground) for reading in meant]
    return min(verdicts, key=lambda verdict: verdict[0])[1]


def _verdict(read: Parse, ground: Ground) -> tuple[float, Verdict]:
    """Return how strongly a reading is contradicted, and the verdict on it."""
    problems = [] if last_stop(read) is not None else ["the text does not say where to stop"]
    claims = claims_of(read, ground)
    found = align(claims, ground)
    strength = len(problems) + sum(one.strength for one in found)
    if strength < REFUSED:
        found = []
    problems += [f"{_said(read, one.clause)}: {one.reason}" for one in found]
    unchecked = _unchecked(read, {claim.clause for claim in claims if not claim.maybe})
    return strength, Verdict(tuple(problems), _spans(read, found), unchecked)


def _unchecked(read: Parse, claiming: set[int]) -> float:
    """Return the share of words in clauses that make no claim and name nothing known."""
    empty = total = 0
    for k, clause in enumerate(read.clauses):
        words = len(read.text[clause.start : clause.stop].split())
        total += words
        if k not in claiming and not any(
            n.kind in ("object", "room", "door") for n in clause.nouns
        ):
            empty += words
    return empty / max(1, total)


def _said(read: Parse, clause: int) -> str:
    if clause >= len(read.clauses):
        return "the text"
    part = read.clauses[clause]
    return f"“{read.text[part.start : part.stop].strip(' ,.;')}”"


def _spans(
    read: Parse, found: Sequence[Contradiction]
) -> tuple[tuple[int, int, tuple[str, ...]], ...]:
    return tuple(
        sorted(
            (c.start, c.stop, tuple(one.reason for one in found if one.clause == index))
            for index, c in enumerate(read.clauses)
        )
    )
