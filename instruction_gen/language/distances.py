"""Reading distances: `four metres`, `about 3 m`, `a couple of steps`."""

from __future__ import annotations

from collections.abc import Sequence

from .lexicon import NUMBERS, UNITS_M

STEPS = frozenset(("step", "steps"))
_VAGUE = frozenset("few couple little short some several".split())
_VAGUE_AMOUNT = 2.5


def read_distance(words: Sequence[str]) -> tuple[float, bool, int] | None:
    """Return the distance [m] that begins a run of words, whether vague, and its word count."""
    k, amount, vague = 0, 0.0, False
    if words[0] in ("a", "another", "one", "the"):
        k = 1
    if k < len(words) and words[k] in _VAGUE:
        amount, vague, k = _VAGUE_AMOUNT, True, k + 1
        while k < len(words) and words[k] in ("of", "more"):
            k += 1
    elif k < len(words) and (words[k] in NUMBERS or _number(words[k])):
        amount = float(NUMBERS[words[k]] if words[k] in NUMBERS else words[k])
        k += 1
        if k + 2 < len(words) and words[k] == "and" and words[k + 1] in ("a", "half"):
            amount, k = amount + 0.5, k + (3 if words[k + 1] == "a" else 2)
        while k < len(words) and words[k] in ("or", "more", "to", "further", "-", *NUMBERS):
            k += 1
    elif words[0] in ("a", "one", "another") and k < len(words) and words[k] in UNITS_M:
        amount = 1.0
    if not amount or k >= len(words) or words[k] not in UNITS_M:
        return None
    return amount * UNITS_M[words[k]], vague, k + 1


def _number(word: str) -> bool:
    return word.replace(".", "", 1).isdigit()
