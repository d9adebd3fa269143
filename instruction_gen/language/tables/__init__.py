"""The vocabulary as data: things, rooms, verbs, phrases that mean other words, and fillers."""

from importlib.resources import files


def table_text(name: str) -> str:
    """Return the text of a table: `objects`, `rooms`, `verbs`, `phrases` or `fillers`."""
    return (files(__package__) / f"{name}.txt").read_text(encoding="utf-8")
