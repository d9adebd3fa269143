"""Verbs, prepositions, phrases and other small words of route instructions, as plain tables."""

from functools import cache

from .tables import table_text

_VERB_ROWS = (row.partition(":") for row in table_text("verbs").replace("\n ", " ").splitlines())
# The kind of each form; of two verbs in a clause the first that is not `go` decides.
VERB_OF = {form: kind for kind, _, forms in _VERB_ROWS for form in forms.split()}
# Prepositions by what they say of the place that follows.
PREPOSITIONS = {
    "past": "past by beyond alongside passing",
    "along": "along down up",
    "through": "through via",
    "across": "across over",
    "into": "into inside_to onto",
    "from": "from off",
    "to": "to",
    "toward": "toward towards for",
    "at": "at near beside against on alongside next_to opposite under beneath below underneath",
    "before": "before",
    "behind": "behind",
    "after": "after",
    "outside": "outside",
    "in": "in inside within",
    "with": "with facing",
    "between": "between amid",
    "around": "around round",
    "of": "of",
    "than": "than",
}
PREP_OF = {word: prep for prep, words in PREPOSITIONS.items() for word in words.split()}

# Words that deny or forbid.
NEGATIONS = frozenset(
    "not no never without nor neither ignore ignoring skip skipping avoid avoiding except unless "
    "rather cannot nothing none alone".split()
)
JOINTS = frozenset("and then but so while or".split())
UNTIL = frozenset("UNTIL".split())
SLIGHT = frozenset(
    "slight slightly gentle gently bit little soft softly diagonally somewhat easy".split()
)
SHARP = frozenset("sharp sharply hard".split())
# Verbs that turn only gently.
BENDS = frozenset(
    "bear bearing veer veering curve curving bend bending bends angle slant drift lean curl".split()
)
# After these, `right` is an adverb: "right past the sofa".
RIGHT_ADVERB = frozenset(
    "past by beside before after behind between next where outside inside opposite when once until "
    "as".split()
)
DETERMINERS = frozenset(
    "the a an your this that these those another its his her their each every any some both all "
    "our one's".split()
)
PRONOUNS = frozenset("it them one ones".split())
UNITS_M = {
    **dict.fromkeys("metre metres meter meters m".split(), 1.0),
    **dict.fromkeys("foot feet ft".split(), 0.305),
    **dict.fromkeys("yard yards".split(), 0.914),
    **dict.fromkeys("step steps pace paces stride strides".split(), 0.72),
    **dict.fromkeys("mile miles".split(), 1609.0),
    **dict.fromkeys("kilometre kilometres kilometer kilometers km".split(), 1000.0),
    **dict.fromkeys("centimetre centimetres centimeter centimeters cm".split(), 0.01),
    **dict.fromkeys("inch inches".split(), 0.0254),
    **dict.fromkeys("minute minutes".split(), 50.0),
    **dict.fromkeys("block blocks".split(), 80.0),
}  # fmt: skip
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
VAGUE_COUNTS = frozenset("few couple several some little short".split())
# Parts of a thing or room, which stand for it: "past the end of the table".
PARTS = frozenset(
    """end ends side corner edge foot head middle center centre back front rest length far start top
    bottom half mouth threshold direction finish beginning face width side's corners sides edges
    legs arm""".split()
)
# Nouns without a place, and small words that claim nothing.
FILLERS = frozenset(table_text("fillers").split())


def _table() -> dict[tuple[str, ...], tuple[str, ...]]:
    result = {}
    for line in table_text("phrases").strip().replace("|\n", "|").splitlines():
        phrases, _, meaning = line.partition("=")
        for phrase in phrases.split("|"):
            result[tuple(phrase.split())] = tuple(meaning.split())
    return result


@cache
def phrases() -> dict[tuple[str, ...], tuple[str, ...]]:
    """Return the phrases that are read as other words."""
    return _table()


LONGEST_PHRASE = 6
