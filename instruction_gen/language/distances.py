"""Reading distances: `four metres`, `about 3 m`, `a couple of steps`."""

from collections.abc import Sequence

from .lexicon import NUMBERS, UNITS_M

STEPS = frozenset(("step", "steps"))
_VAGUE = frozenset("few couple little short some several".split())
_VAGUE_AMOUNT = 2.5
_BEFORE_UNIT = frozenset("or to further - more small little short big long quick good".split())


def read_distance(words: Sequence[str]) -> tuple[float, bool, int] | None:
    """Return the distance [m] that begins a run of words, whether vague, and its word count."""
    if tuple(words[:2]) == ("half", "a") and words[2:3] and words[2] in UNITS_M:
        return 0.5 * UNITS_M[words[2]], False, 3
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
        while k < len(words) and (words[k] in _BEFORE_UNIT or words[k] in NUMBERS):
            k += 1
    elif words[0] in ("a", "one", "another") and k < len(words) and words[k] in UNITS_M:
        amount = 1.0
    if not amount or k >= len(words) or words[k] not in UNITS_M:
        return None
    unit_m, k = UNITS_M[words[k]], k + 1
    after = tuple(words[k : k + 3])
    if after == ("and", "a", "half"):  # "another metre and a half"
        return (amount + 0.5) * unit_m, vague, k + 3
    if after[:1] == ("or",) and (after[1:2] == ("so",) or (after[1:2] and after[1] in NUMBERS)):
        return (amount + 0.5) * unit_m, vague or amount <= 1, k + 2  # "a step or two"
    return amount * unit_m, vague, k


def _number(word: str) -> bool:
    return word.replace(".", "", 1).isdigit()
