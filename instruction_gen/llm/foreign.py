"""Texts in other languages than English, compared with their English, which is checked in full.

What can be compared: script, the word for stopping, sides and the order of turns, distances, and
rooms and common things, colours, counts and ordinals. What cannot: prepositions, and nouns not in
the tables.
"""

import re
import unicodedata
from collections.abc import Mapping, Sequence

from ..checker import Ground, Verdict, check_text
from ..language.claims import Claim
from ..language.lexicon import COLOURS
from ..language.reader import read_text
from .foreign_words import (
    COLOUR_WORDS,
    COUNT,
    DISTANCE,
    LEFT,
    NOUNS,
    NUMBER_WORDS,
    ORDINAL,
    RIGHT,
    SCRIPT,
    STOP,
    TURN_LEFT,
    TURN_RIGHT,
)

_SIDES = re.compile(r"\b(left|right)\b", re.IGNORECASE)
_METRES_OFF = 0.6


def check_in(language: str, text: str, english: str, ground: Ground) -> Verdict:
    """Check a text in any language.

    Args:
        english: the same in English, of a text in another language; "" where there is none.
    """
    if language == "en":
        return check_text(text, ground)
    if not english:
        problems = ["there is no English of it to check"]
    else:
        problems = foreign_problems(text, language, english)
        problems = problems or [f"its English: {p}" for p in check_text(english, ground).problems]
    return Verdict(tuple(problems), ((0, len(text), tuple(problems)),))


def foreign_problems(text: str, language: str, english: str) -> list[str]:
    """Return what is wrong with a text, given its English."""
    if any(unicodedata.category(c) in ("Cc", "Co", "Cs") or c in "{}<>\u202e\u202d" for c in text):
        return ["control characters or braces"]
    letters = [c for c in text if unicodedata.category(c)[0] == "L"]
    own = sum(unicodedata.name(c, "").startswith(SCRIPT[language]) for c in letters)
    if len(letters) < 5 or own < 0.8 * len(letters):
        return [f"not in the language asked for ({language})"]
    problems = []
    if not re.search(STOP[language], text):
        problems.append("it does not say where to stop")
    sides = _either(text, LEFT[language], RIGHT[language])
    meant = [side.lower() for side in _SIDES.findall(english)]
    claims = [claim for step in read_text(english) for claim in step.claims]
    turns = _either(text, TURN_LEFT[language], TURN_RIGHT[language])
    expected = [c.side for c in claims if c.kind == "turn" and c.side in ("left", "right")]
    if sorted(sides) != sorted(meant):
        problems.append(f"its sides ({', '.join(sides)}) are not the English ({', '.join(meant)})")
    elif len(turns) == len(expected) and turns != expected:
        problems.append(
            f"its turns ({', '.join(turns)}) are not the English ({', '.join(expected)})"
        )
    problems += _distance_problems(text, language, [c.metres for c in claims])
    problems += _colour_problems(text, COLOUR_WORDS[language], english)
    problems += _count_problems(text, language, claims)
    return problems + _noun_problems(text, NOUNS[language], english)


def _either(text: str, left: str, right: str) -> list[str]:
    found = re.findall(f"(?P<left>{left})|(?P<right>{right})", text)
    return ["left" if one else "right" for one, _ in found]


def _distance_problems(text: str, language: str, english_m: list[float]) -> list[str]:
    problems = []
    for said in re.findall(DISTANCE[language], text):
        metres = _number(said, NUMBER_WORDS[language])
        if metres and not any(abs(metres - m) <= _METRES_OFF for m in english_m if m):
            problems.append(f"{said} metres are not in the English")
    return problems


def _colour_problems(text: str, words: Mapping[str, str], english: str) -> list[str]:
    """Return the colours of the tables that the English does not say."""
    mentioned = {COLOURS[w] for w in re.findall(r"[a-z]+", english.lower()) if w in COLOURS}
    found = {colour: match[0] for word, colour in words.items() if (match := re.search(word, text))}
    return [f"{said} is not in the English" for c, said in found.items() if c not in mentioned]


def _count_problems(text: str, language: str, claims: Sequence[Claim]) -> list[str]:
    """Return the counts from two on, and the ordinals, that the English does not say."""
    words = NUMBER_WORDS[language]
    counts = {c.count for c in claims}
    ordinals = {c.ordinal for c in claims}
    things = "|".join(sorted(map(re.escape, NOUNS[language]), key=len, reverse=True))
    problems = []
    for said in re.findall(COUNT[language].format(nouns=things), text):
        if (number := _number(said, words)) > 1 and number not in counts:
            problems.append(f"{said} of them are not in the English")
    for number, word in ORDINAL[language].items():
        found = re.search(word, text)
        if found and number not in ordinals:
            problems.append(f"{found[0]} is not in the English")
    return problems


def _number(said: str, words: Mapping[str, int]) -> float:
    if said in words:
        return float(words[said])
    try:
        return float(said)  # digits of any script
    except ValueError:
        return 0.0


def _noun_problems(text: str, nouns: Mapping[str, str], english: str) -> list[str]:
    """Return the rooms and things of the tables that the English does not speak of."""
    problems = []
    lower = english.lower()
    rest = text
    # The longest first: 茶几 and 餐桌 before 桌.
    for word in sorted(nouns, key=len, reverse=True):
        if word not in rest:
            continue
        rest = rest.replace(word, " ")
        if not re.search(rf"\b(?:{nouns[word]})", lower):
            problems.append(f"{word} is not in the English")
    return problems
