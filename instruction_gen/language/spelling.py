"""Misspelt words, read as the known words that they are one letter, blank or apostrophe from.

A word of any table is never changed, nor is an English word: `real.txt` holds those that are so
near to a known word, from the English list of pyspellchecker (MIT).
"""

from collections.abc import Iterator
from functools import cache

from .lexicon import DOORS, OBJECT_PHRASES, ROOM_PHRASES, noun_kind, singular
from .tables import closed, table_text
from .words import KNOWN, NUMBERS, is_known, phrases

_LEAST_LETTERS = 4
_LETTERS = "abcdefghijklmnopqrstuvwxyz"
_ENDINGS = ("re", "ll", "ve", "nt")
_STEMS = closed("before an apostrophe")


@cache
def respelt(word: str) -> str:
    """Return the words that an unknown word stands for, "" where there is no or no single one."""
    known = _words()
    if len(word) < _LEAST_LETTERS or not word.isalpha() or word in known | _real():
        return ""
    if is_known(word):
        return ""
    for ending in _ENDINGS:  # "youre", "doesnt"
        stem = word.removesuffix(ending)
        if stem != word and stem in _STEMS:
            return f"{stem}n't" if ending == "nt" else f"{stem}'{ending}"
    near = set(_one_edit(word)) & known
    near |= _closed_up().get(word, set())
    near |= {f"{word[:k]} {word[k:]}" for k in range(3, len(word) - 2)
             if word[:k] in known and word[k:] in known}  # fmt: skip
    # "tabls" may be a table or tables.
    nouns = {singular(other) for other in near}
    return (
        min(near, key=lambda other: (other != word.rstrip("s"), other)) if len(nouns) == 1 else ""
    )


@cache
def closed_gap(word: str, after: str) -> str:
    """Return the noun that is written as two words: `hall way`, "" where there is none."""
    whole = word + after
    own = len(whole) > _LEAST_LETTERS and noun_kind(whole) in ("thing", "room", "door")
    return whole if own else ""  # not "down stairs"


def _one_edit(word: str) -> Iterator[str]:
    """Yield the words with a letter less, more, changed, or two exchanged, but the first."""
    for k in range(1, len(word) + 1):
        head, tail = word[:k], word[k:]
        yield from (head + letter + tail for letter in _LETTERS)
        if tail:
            yield head + tail[1:]
            yield from (head + letter + tail[1:] for letter in _LETTERS)
        if len(tail) > 1:
            yield head + tail[1] + tail[0] + tail[2:]


@cache
def _words() -> frozenset[str]:
    """Return all known words of at least two letters."""
    nouns = {word for phrase in (*OBJECT_PHRASES, *ROOM_PHRASES, *DOORS) for word in phrase.split()}
    said = {word for phrase in phrases() for word in phrase}
    words = {*KNOWN, *NUMBERS, *nouns, *(f"{noun}s" for noun in nouns), *said}
    return frozenset(word for word in words if word.isalpha() and word.islower() and word[1:])


@cache
def _closed_up() -> dict[str, set[str]]:
    """Return the nouns of several words by what they are without blanks."""
    result: dict[str, set[str]] = {}
    for phrase in (*OBJECT_PHRASES, *ROOM_PHRASES):
        if " " in phrase:
            result.setdefault(phrase.replace(" ", ""), set()).add(phrase)
    return result


@cache
def _real() -> frozenset[str]:
    return frozenset(table_text("real").split())
