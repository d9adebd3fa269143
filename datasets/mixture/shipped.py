"""The recipes that come along, by name."""

from __future__ import annotations

from pathlib import Path

from ...formats.core.errors import InputError

FOLDER = Path(__file__).resolve().parents[1] / "recipes"


def recipe_path(name: str) -> Path:
    """The file of a recipe: the one that `name` leads to, else the shipped one of that name.

    Raises:
        InputError: neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    shipped = {p.stem: p for p in sorted(FOLDER.glob("*.yaml"))}
    if name in shipped:
        return shipped[name]
    raise InputError(f"recipe {name}: no such file; shipped recipes: {', '.join(shipped)}")
