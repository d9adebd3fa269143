"""The vocabulary as data: things, rooms, verbs, phrases that mean other words, and fillers."""

from functools import cache
from importlib.resources import files


def table_text(name: str) -> str:
    """Return the text of a table: `objects`, `rooms`, `phrases` or `fillers`."""
    return (files(__package__) / f"{name}.txt").read_text(encoding="utf-8")


@cache
def rows_of(name: str) -> dict[str, tuple[str, ...]]:
    """Return the rows `name: words` of a table such as `closed` or `verbs`.

    A line that begins with a blank goes on with the row before; a row that begins with # is none.
    """
    rows = table_text(name).replace("\n ", " ").splitlines()
    parts = (row.partition(": ") for row in rows if not row.startswith("#"))
    return {key: tuple(words.split()) for key, _, words in parts}


def kind_of_word(name: str) -> dict[str, str]:
    """Return the name of the row of each word of such a table."""
    return {word: kind for kind, words in rows_of(name).items() for word in words}


def closed(name: str) -> frozenset[str]:
    """Return a closed class of words."""
    return frozenset(rows_of("closed")[name])
