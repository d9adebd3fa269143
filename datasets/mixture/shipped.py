"""The recipes that come with vlnpe.

Imports little, since the help of the command line lists them, too.
"""

from pathlib import Path

from ...formats.core.errors import InputError, did_you_mean

_FOLDER = Path(__file__).resolve().parents[1] / "recipes"
SHIPPED = {path.stem: path for path in sorted(_FOLDER.glob("*.yaml"))}


def recipe_path(name: str) -> Path:
    """Return the file of a recipe: the path `name`, or the built-in recipe of that name.

    Raises:
        InputError: neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    if name in SHIPPED:
        return SHIPPED[name]
    raise InputError(
        f"recipe {name}{did_you_mean(name, SHIPPED)}: no such file; built-in recipes: "
        f"{', '.join(SHIPPED)}"
    )
