"""From a scan's labels to nouns that may be said, and back."""

import re
from functools import cache

from .lexicon import (
    ADJECTIVES,
    COLOURS,
    MATERIALS,
    OBJECT_PHRASES,
    OBJECTS,
    ROOM_PHRASES,
    ROOMS,
    singular,
)

_WORD = re.compile(r"[a-z]+(?:-[a-z]+)?")
_LONGEST_LABEL = 40
_ROOM_WORDS = frozenset(w for phrase in ROOM_PHRASES for w in phrase.split()) - {"room", "area"}
_SAID_OF = COLOURS.keys() | MATERIALS.keys()
_SPOKEN = {"tv": "TV", "pc": "PC", "airconditioner": "air conditioner"}


@cache
def noun_of(label: str) -> str:
    """Return the noun for an object's category, "" when its words are not those of a thing indoors.

    `SofaC_1` and `sofa` are `sofa`; a two-word label with known words keeps both
    (`balcony table`).
    """
    words = _words(label)
    while len(words) > 1 and words[0] in _SAID_OF:
        words = words[1:]
    if not 1 <= len(words) <= 3:
        return ""
    phrase = " ".join(words)
    for known in (phrase, " ".join([*words[:-1], singular(words[-1])])):
        if known in OBJECTS:
            return known
        if known in OBJECT_PHRASES:
            exact = [n for n in sorted(OBJECT_PHRASES[known]) if known in OBJECTS[n][0]]
            if exact:
                return exact[0]
    head = singular(words[-1])
    known_word = _ROOM_WORDS | ADJECTIVES | OBJECT_PHRASES.keys()
    if head in OBJECTS and all(word in known_word for word in words[:-1]):
        return " ".join([*words[:-1], head])
    return ""


@cache
def looks_of(label: str) -> tuple[str, str]:
    """Return colour and material in a label, "" if it has none: `red leather sofa`."""
    if not noun_of(label):
        return "", ""
    words = _words(label)[:-1]
    colour = next((COLOURS[w] for w in words if w in COLOURS), "")
    return colour, next((MATERIALS[w] for w in words if w in MATERIALS), "")


@cache
def room_of(label: str) -> str:
    """Return the canonical name of a room's label, "" when it is no known kind of room."""
    phrase = " ".join(_words(label.replace("'s", "s")))
    if phrase in ROOMS:
        return phrase
    return next(iter(sorted(ROOM_PHRASES.get(phrase, ()))), "")


@cache
def answers(noun: str) -> frozenset[str]:
    """Return all phrases, in the singular, by which a person may call a noun of `noun_of`."""
    if noun in OBJECTS:
        same, kinds = OBJECTS[noun]
        return same | kinds
    head = noun.split()[-1]
    same, kinds = OBJECTS.get(head, (frozenset({head}), frozenset()))
    return same | kinds | {noun}


@cache
def called(noun: str, phrase: str) -> bool:
    """Return whether a person may call a noun of `noun_of` by a phrase in the singular.

    Beside the phrases of `answers` a compound of its own words: `shoe storage cabinet` is a shoe
    cabinet, `flat screen stand` a TV stand.
    """
    if phrase in answers(noun):
        return True
    *modifiers, kind = phrase.split()
    if not modifiers or not answers(noun) & {kind, f"{modifiers[-1]} {kind}"}:
        return False
    names = [name.split() for name in answers(noun)]
    own = {word for name in names for word in name}
    for word in {w for name in names for w in name[:-1]}:
        same = [OBJECTS[n][0] for n in OBJECT_PHRASES.get(word, ()) if word in OBJECTS[n][0]]
        own |= {w for said in same for name in said for w in name.split()}
    return own.issuperset(set(modifiers) - _NEUTRAL)


_NEUTRAL = frozenset("storage set unit room".split())


@cache
def room_answers(room: str) -> frozenset[str]:
    """Return all phrases by which a person may call a room of `room_of`."""
    same, kinds = ROOMS.get(room, (frozenset({room}), frozenset()))
    return same | kinds


def spoken(noun: str, plural: bool = False) -> str:
    """Return how a noun is written: `tv stand` → `TV stand`; several → `TV stands`."""
    words = [_SPOKEN.get(w, w) for w in noun.split()]
    if plural:
        last = words[-1]
        if last in ("shelf", "bookshelf"):
            words[-1] = last[:-1] + "ves"
        elif last.endswith(("s", "x", "ch", "sh")):
            words[-1] = last + "es"
        else:
            words[-1] = last + "s"
    return " ".join(words)


def _words(label: str) -> list[str]:
    text = label[: _LONGEST_LABEL + 1]
    if len(text) > _LONGEST_LABEL or not text.isascii() or re.search(r"[^A-Za-z0-9 _.-]", text):
        return []
    return _WORD.findall(re.sub(r"[_.-]|\d", " ", text.lower()))
