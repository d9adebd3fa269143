"""Verbs, prepositions, phrases and other small words of route instructions, as plain tables."""

from functools import cache

from .lexicon import ADJECTIVES, COLOURS, MATERIALS, noun_kind, singular
from .tables import closed, kind_of_word, rows_of, table_text

# The kind of each form; of two verbs in a clause the first that is not `go` decides.
VERB_OF = kind_of_word("verbs")
# What each preposition says of the place that follows.
PREP_OF = kind_of_word("prepositions")

# Words that deny or forbid.
NEGATIONS = closed("negation")
JOINTS = closed("joint")
# What may be wider than a doorway.
OPENINGS = closed("opening")
SLIGHT = closed("slight")
SHARP = closed("sharp")
# Verbs that turn only gently.
BENDS = closed("bend")
# After these, `right` is an adverb: "right past the sofa".
RIGHT_ADVERB = closed("after right")
DETERMINERS = closed("determiner")
PRONOUNS = closed("pronoun")
UNITS_M = {word: float(metres) for word, metres in kind_of_word("units").items()}
_SMALL, _TENS, _ORDINALS = (
    rows_of("closed")[name] for name in ("zero to nineteen", "tens", "ordinals")
)
NUMBERS: dict[str, float] = {
    **{word: float(n) for n, word in enumerate(_SMALL)},
    **{word: 10.0 * n for n, word in enumerate(_TENS, start=2)},
    **{f"{t}-{w}": 10.0 * n + m for n, t in enumerate(_TENS, start=2)
       for m, w in enumerate(_SMALL[1:10], start=1)},
    "hundred": 100.0, "thousand": 1000.0, "dozen": 12.0, "half": 0.5, "quarter": 0.25,
    "double": 2.0, "couple": 2.0, "pair": 2.0,
}  # fmt: skip
ORDINALS = {
    **{word: n for n, word in enumerate(_ORDINALS, start=1)},
    **{f"{n}{e}": n for n in range(1, 31) for e in ("st", "nd", "rd", "th")},
    **{"last": -1, "final": -1},
}
VAGUE_COUNTS = closed("vague count")
# Parts of a thing or room, which stand for it: "past the end of the table".
PARTS = closed("part")
# Nouns without a place, and small words that claim nothing.
FILLERS = frozenset(table_text("fillers").split())
# Words that need no claim: they say nothing that facts can refute.
SMALL = frozenset().union(
    FILLERS, VERB_OF, PREP_OF, DETERMINERS, ORDINALS, PARTS, JOINTS, SLIGHT, SHARP
)
KNOWN = SMALL.union(
    ADJECTIVES, COLOURS, MATERIALS, UNITS_M, VAGUE_COUNTS, NEGATIONS, PRONOUNS, ("left", "right")
)


def number_of(word: str) -> float | None:
    """Return the value of a number in words or digits, None for other words."""
    if word in NUMBERS:
        return NUMBERS[word]
    ends = word.replace("–", "-").split("-")  # "4-5"
    if len(ends) < 3 and all(end.replace(".", "", 1).isdecimal() for end in ends):
        return sum(map(float, ends)) / len(ends)
    return None


def is_known(word: str) -> bool:
    """Return whether a word is in any table."""
    forms = KNOWN.intersection((word, singular(word)))
    named = forms or noun_kind(word) or number_of(word) is not None
    return bool(named) or not word[0].isalpha() or word.isupper() or "_" in word


@cache
def phrases() -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the phrases that are read as other words."""
    result = {}
    for line in table_text("phrases").strip().replace("|\n", "|").splitlines():
        alike, _, meaning = line.partition("=")
        result |= {tuple(phrase.split()): tuple(meaning.split()) for phrase in alike.split("|")}
    return result


LONGEST_PHRASE = 6
