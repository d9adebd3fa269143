"""Verbs, prepositions, phrases and other small words of route instructions, as plain tables."""

from functools import cache

from .tables import closed, kind_of_word, table_text

# The kind of each form; of two verbs in a clause the first that is not `go` decides.
VERB_OF = kind_of_word("verbs")
# What each preposition says of the place that follows.
PREP_OF = kind_of_word("prepositions")

# Words that deny or forbid.
NEGATIONS = closed("negation")
JOINTS = closed("joint")
SLIGHT = closed("slight")
SHARP = closed("sharp")
# Verbs that turn only gently.
BENDS = closed("bend")
# After these, `right` is an adverb: "right past the sofa".
RIGHT_ADVERB = closed("after right")
DETERMINERS = closed("determiner")
PRONOUNS = closed("pronoun")
UNITS_M = {word: float(metres) for word, metres in kind_of_word("units").items()}
_SMALL = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen "
    "sixteen seventeen eighteen nineteen"
).split()
_TENS = "twenty thirty forty fifty sixty seventy eighty ninety".split()
NUMBERS: dict[str, float] = {
    **{word: float(n) for n, word in enumerate(_SMALL)},
    **{word: 10.0 * n for n, word in enumerate(_TENS, start=2)},
    **{f"{t}-{w}": 10.0 * n + m for n, t in enumerate(_TENS, start=2)
       for m, w in enumerate(_SMALL[1:10], start=1)},
    "hundred": 100.0, "thousand": 1000.0, "dozen": 12.0, "half": 0.5, "quarter": 0.25,
    "double": 2.0, "couple": 2.0, "pair": 2.0,
}  # fmt: skip
_ORDINALS = (
    "first second third fourth fifth sixth seventh eighth ninth tenth eleventh twelfth thirteenth "
    "fourteenth fifteenth sixteenth seventeenth eighteenth nineteenth twentieth"
).split()
ORDINALS = {
    **{word: n for n, word in enumerate(_ORDINALS, start=1)},
    **{f"{n}{e}": n for n in range(1, 31) for e in ("st", "nd", "rd", "th")},
    "last": -1,
    "final": -1,
}
VAGUE_COUNTS = closed("vague count")
# Parts of a thing or room, which stand for it: "past the end of the table".
PARTS = closed("part")
# Nouns without a place, and small words that claim nothing.
FILLERS = frozenset(table_text("fillers").split())


@cache
def phrases() -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the phrases that are read as other words."""
    result = {}
    for line in table_text("phrases").strip().replace("|\n", "|").splitlines():
        alike, _, meaning = line.partition("=")
        result |= {tuple(phrase.split()): tuple(meaning.split()) for phrase in alike.split("|")}
    return result


LONGEST_PHRASE = 6
