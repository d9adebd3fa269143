"""Reading sides: `left`, `to the left`, `on your right-hand side`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .function_words import SHARP, SLIGHT

_BEFORE = frozenset(("immediate", "far", "very", "near", "wide", "half")) | SLIGHT | SHARP


@dataclass(frozen=True)
class Side:
    """A side as it is said.

    Attributes:
        side: `left` or `right`.
        prep: `on`, `to`, … before it, "" = none.
        determined: `your`, `the` or `a` stands before it.
        degree: `slight`, `sharp` or "".
        words: how many words it takes.
        after: the word that follows, "" at the end.
    """

    side: str
    prep: str
    determined: bool
    degree: str
    words: int
    after: str


def read_side(words: Sequence[str]) -> Side | None:
    """Return the side that begins a run of words, None when none does."""
    k = 0
    degree = ""
    prep = words[0] if words[0] in ("on", "to", "at", "in", "off") else ""
    if prep:
        k += 1
        while k < len(words) and words[k] in ("off", "over"):
            k += 1
    determined = k < len(words) and words[k] in ("your", "the", "its", "a", "an")
    k += determined
    while k < len(words) and words[k] in _BEFORE:
        if words[k] in SLIGHT | SHARP | {"half"}:
            degree = "sharp" if words[k] in SHARP else "slight"
        k += 1
    if k >= len(words) or words[k] not in ("left", "right", "left-hand", "right-hand"):
        return None
    side = words[k].split("-")[0]
    k += 1
    for following in ("hand", "side"):
        k += k < len(words) and words[k] == following
    return Side(side, prep, determined, degree, k, words[k] if k < len(words) else "")
