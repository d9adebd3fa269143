"""The verdict about a text: what its claims get wrong, and what no claim covers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..language.claims import Step
from ..language.loose import remarks
from ..language.reader import readings
from ..language.tokens import misspelt
from ..language.words import is_known
from .accounting import accounting_problems, as_worded
from .form import form_problems
from .ground import Ground
from .order import check_order
from .said import goal_last


@dataclass(frozen=True)
class Verdict:
    """What is wrong with a text.

    Attributes:
        problems: why it is refused; none where it is accepted.
        clauses: start and end of its clauses in the text, and what is wrong with each.
        unchecked: words that no claim covers, and misspelt ones with how they are read.
        steps: the steps with the claims that were checked.
    """

    problems: tuple[str, ...]
    clauses: tuple[tuple[int, int, tuple[str, ...]], ...] = ()
    unchecked: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


def check_text(text: str, ground: Ground, steps: Sequence[Step] = ()) -> Verdict:
    """Check a text against the facts of its path.

    Args:
        steps: the text with its claims, from its writer. Their claims must hold and cover the
            words. Without them claims are read from the text where they are certain, and the
            other words are returned as unchecked.
    """
    problems = form_problems(text)
    if problems:
        return Verdict(tuple(problems), ((0, len(text), tuple(problems)),))
    if steps:
        steps = tuple(as_worded(step) for step in steps)
        verdict = _judged(text, goal_last(steps), ground, accounting_problems(steps, text))
        return replace(verdict, steps=steps)
    verdicts = []
    for read in readings(text):
        faults = [(k, fault) for k, step in enumerate(read) for fault in step.faults]
        verdicts.append(_judged(text, read, ground, faults + _idle_sentences(text, read)))
        if verdicts[-1].ok:
            return verdicts[-1]
    return verdicts[0]


def _judged(
    text: str, steps: Sequence[Step], ground: Ground, found: list[tuple[int, str]]
) -> Verdict:
    """Return the verdict, given what is wrong with the words of the steps."""
    owners = [k for k, step in enumerate(steps) for _ in step.claims]
    claims = [claim for step in steps for claim in step.claims]
    if not any(c.kind == "stop" for c in claims):
        found.append((len(steps) - 1, "the text does not say where to stop"))
    found += [(owners[p.index], p.reason) for p in check_order(claims, owners, ground)]
    clauses, at = [], 0
    for number, step in enumerate(steps):
        start = max(text.find(step.words, at), 0)
        at = start + len(step.words)
        reasons = tuple(dict.fromkeys(r for k, r in found if k == number))
        clauses.append((start, at, reasons))
    every = tuple(dict.fromkeys(reason for _, reason in found))
    unchecked = (*(w for step in steps for w in step.unchecked), *misspelt(text))
    return Verdict(every, tuple(clauses), unchecked, tuple(steps))


def _idle_sentences(text: str, steps: Sequence[Step]) -> list[tuple[int, str]]:
    """Return the sentences that claim nothing and hold words that belong into no route."""
    result = []
    group: list[int] = []
    for number, step in enumerate(steps):
        group.append(number)
        end = step.start + len(step.words)
        after = text[end : steps[number + 1].start] if number + 1 < len(steps) else "."
        if not any(c in ".!?;" for c in after):
            continue
        odd = [w for k in group for w in steps[k].unchecked if not is_known(w)]
        aside = remarks(steps[group[0]].words.lower().split())
        if odd and not aside and not any(steps[k].claims for k in group):
            result.append((group[0], f"a sentence that claims nothing: {', '.join(odd[:4])}"))
        group = []
    return result
