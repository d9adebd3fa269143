"""The verdict about a text: what its claims get wrong, and what no claim covers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..language.claims import Claim, Step
from ..language.clauses import verb_at
from ..language.loose import remarks
from ..language.reader import readings
from ..language.tables import closed
from ..language.tokens import misspelt, tokenize
from ..language.words import is_known
from .accounting import accounting_problems, as_worded
from .form import form_problems
from .ground import Ground
from .order import check_order, holds_somewhere
from .said import goal_last

_PREFACE = re.compile(r"[^.!?;:]+[.!?;:]\s+(?=\S)")
_OWN_STEP = ("turn", "walk", "leave")  # of a way that is told, not summed up
_BEGINS = closed("begins") | {"first"}


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
    verdict = _read(text, ground)
    if not verdict.ok and (preface := _PREFACE.match(text)) and _holds(preface[0], ground):
        rest = _read(text[preface.end() :], ground)
        if rest.ok and _starts(rest.steps):
            return _behind(preface[0], rest)
    return verdict


def _read(text: str, ground: Ground) -> Verdict:
    """Return the verdict about a text without claims, of the first reading that is accepted."""
    verdicts = []
    for read in readings(text):
        faults = [(k, fault) for k, step in enumerate(read) for fault in step.faults]
        verdicts.append(_judged(text, read, ground, faults + _idle_sentences(text, read)))
        if verdicts[-1].ok:
            return verdicts[-1]
    return verdicts[0]


def _holds(preface: str, ground: Ground) -> bool:
    """Return whether a sentence that sums up the way before it is told says nothing false.

    "The toys go to the kitchen. From the hall …": each of its claims must hold somewhere, and the
    last room must be that of the goal.
    """
    steps = _preface_steps(preface)
    claims = [claim for step in steps for claim in step.claims]
    told = any(c.kind in _OWN_STEP for c in claims) or any(step.faults for step in steps)
    if told or not claims or verb_at(tokenize(preface), 0) not in ("", "see"):
        return False
    rooms = [Claim("stop", "room", c.room or c.name) for c in claims if c.room or c.what == "room"]
    bare = Claim("see", "thing")
    own = [c for c in claims if replace(c, name="") != bare]
    return all(holds_somewhere(claim, ground) for claim in own + rooms[-1:])


def _preface_steps(preface: str) -> Sequence[Step]:
    return next(readings(f"{preface} Stop."))[:-1]


def _starts(steps: Sequence[Step]) -> bool:
    """Return whether steps begin where the path does: `from the hall`, `first`, `start at`."""
    first = tokenize(steps[0].words)[0].text
    return first in _BEGINS or any(c.kind == "leave" for step in steps[:2] for c in step.claims)


def _behind(preface: str, rest: Verdict) -> Verdict:
    """Return the verdict about a text whose first sentence is a preface that holds."""
    at = len(preface)
    clauses = tuple((start + at, stop + at, why) for start, stop, why in rest.clauses)
    steps = tuple(replace(step, start=step.start + at) for step in rest.steps)
    own = (*(w for step in _preface_steps(preface) for w in step.unchecked), *misspelt(preface))
    unchecked = (*own, *rest.unchecked)
    return replace(rest, clauses=((0, at, ()), *clauses), steps=steps, unchecked=unchecked)


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
        told = sum(len(steps[k].words.split()) for k in group)
        odd = odd if len(odd) > 1 or 3 * len(odd) >= told else []  # not "there is no hurry"
        if odd and not aside and not any(steps[k].claims for k in group):
            result.append((group[0], f"a sentence that claims nothing: {', '.join(odd[:4])}"))
        group = []
    return result
