"""The verdict on a text."""

from __future__ import annotations

from dataclasses import dataclass

from ..facts.records import PathFacts
from ..language.clauses import Parse
from ..language.ending import last_stop, readings
from ..language.parse import parse
from .align import align
from .claims import claims_of
from .form import form_problems
from .ground import Ground


@dataclass(frozen=True)
class Verdict:
    """What is wrong with a text.

    Attributes:
        problems: one line each; empty when every claim holds.
        clauses: (start, stop, problems) of each clause, in characters of the text.
    """

    problems: tuple[str, ...]
    clauses: tuple[tuple[int, int, tuple[str, ...]], ...] = ()

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
    verdicts = [_verdict(reading, ground) for reading in readings(read)]
    return next((v for v in verdicts if v.ok), verdicts[-1])


def _verdict(read: Parse, ground: Ground) -> Verdict:
    problems = []
    if last_stop(read) is None:
        problems.append("the text does not say where to stop")
    found = align(claims_of(read, ground), ground)
    spans = _spans(read, found)
    return Verdict((*problems, *(f"{_said(read, k)}: {reason}" for k, reason in found)), spans)


def _said(read: Parse, clause: int) -> str:
    if clause >= len(read.clauses):
        return "the text"
    part = read.clauses[clause]
    return f"“{read.text[part.start : part.stop].strip(' ,.;')}”"


def _spans(
    read: Parse, found: list[tuple[int, str]]
) -> tuple[tuple[int, int, tuple[str, ...]], ...]:
    return tuple(
        (c.start, c.stop, tuple(reason for k, reason in found if k == index))
        for index, c in enumerate(read.clauses)
    )
