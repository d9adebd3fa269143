"""Write several texts for one path, each of them checked."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..checker import Ground, check_text
from ..facts.records import PathFacts
from .realize import realize
from .steps import plan

STYLES = ("natural", "terse", "rich")
ATTEMPTS = 24


@dataclass(frozen=True)
class Composed:
    """A text of the composer.

    Attributes:
        style: one of `STYLES`.
        skeletons: its sentences, with slots for rooms, things, sides and numbers.
        landmarks: names of the things it speaks of, in order.
        attempts: how many drafts it took.
    """

    text: str
    style: str
    skeletons: tuple[str, ...]
    landmarks: tuple[str, ...]
    attempts: int


def compose_texts(
    ground: Ground,
    count: int,
    styles: Sequence[str],
    rng: np.random.Generator,
    taken: Collection[str] = (),
) -> tuple[list[Composed], list[str]]:
    """Write `count` different texts in turn in the given styles.

    Args:
        styles: of `STYLES`.
        taken: texts that other paths have already.

    Returns:
        The texts that pass their check, as many as could be had, and, where that is none, the
        problems of the last draft.
    """
    result: list[Composed] = []
    problems: list[str] = []
    for number in range(count):
        style, facts = styles[number % len(styles)], ground.facts
        refused: set[str] = set()
        for attempt in range(1, ATTEMPTS + 1):
            # A path with few landmarks yields little text: any style will do then. And where things
            # are numbered otherwise than the checker counts them, they are left unsaid.
            if attempt > ATTEMPTS // 2:
                style = STYLES[attempt % len(STYLES)]
                facts = _unnamed(facts, refused)
            steps = plan(facts, style, rng)
            text, skeletons = realize(steps, rng, style)
            if text in taken or any(_alike(text, other.text) for other in result):
                continue
            verdict = check_text(text, ground)
            marks = [r.name for s in steps for r in (s.mark, s.other) if r is not None]
            if verdict.ok:
                result.append(Composed(text, style, tuple(skeletons), tuple(marks), attempt))
                break
            problems = list(verdict.problems)
            refused.update(marks)
    return result, ([] if result else problems)


def _unnamed(facts: PathFacts, names: Collection[str]) -> PathFacts:
    """Return the facts with some things, by name, that no text speaks of."""
    marks = (replace(m, nameable=False) if m.name in names else m for m in facts.landmarks)
    return replace(facts, landmarks=tuple(marks))


def _alike(text: str, other: str) -> bool:
    """Return whether two texts are nearly the same words in the same order."""
    a, b = text.lower().split(), other.lower().split()
    return a == b or a[:5] == b[:5]
