"""Read Matterport3D's `.house` files: rooms and objects of a building, z up, in metres.

The format (lines whose first letter is their kind, fields separated by blanks) is described in
the data set's "data organization" document.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.errors import FileFormatError, brief
from ..scan.files import MAX_HOUSE_BYTES, side_file
from .categories import category_of_name
from .files import LabelBox, within_limit

HEADER = "ASCII 1."
ROOMS = {
    "a": "bathroom", "b": "bedroom", "c": "closet", "d": "dining room", "e": "entrance hall",
    "f": "family room", "g": "garage", "h": "hallway", "i": "library", "j": "laundry room",
    "k": "kitchen", "l": "living room", "m": "meeting room", "n": "lounge", "o": "office",
    "p": "porch", "r": "game room", "s": "stairs", "t": "toilet", "u": "utility room",
    "v": "home cinema", "w": "gym", "x": "outdoors", "y": "balcony", "B": "bar", "C": "classroom",
    "D": "dining booth", "S": "spa",
}  # fmt: skip
# The coarse category goes before the fine one where the repair depends on it.
STRUCTURE = frozenset({"wall", "floor", "ceiling", "door", "window", "stairs", "column"})
# Boxes of walls and the like that are thicker span whole rooms, and say nothing about a face.
THIN = 0.25
NOTHING = frozenset({"void", "misc", "objects", "unlabeled", "unlabelled", "remove", "unknown", ""})


@dataclass(frozen=True)
class House:
    """The boxes of things and rooms in a `.house` file, z up, and the building's bounds (3,)."""

    boxes: list[LabelBox]
    lower: Array
    upper: Array


def read_house(path: Path) -> House | None:
    """Read a `.house` file; None if there is none. Raise FileFormatError if it is damaged."""
    data = side_file(path.parent, path.name, MAX_HOUSE_BYTES)
    if data is None:
        return None
    lines = data.decode(errors="replace").splitlines()
    if not lines or not lines[0].startswith(HEADER):
        raise FileFormatError(path, f"does not begin with {HEADER!r}, as .house files do")
    categories: dict[str, str] = {}
    boxes: list[LabelBox] = []
    bounds: Array | None = None
    for number, line in enumerate(lines[1:], start=2):
        fields = line.split()
        try:
            if fields[:1] == ["H"]:
                bounds = _floats(fields[18:24], 6).reshape(2, 3)
            elif fields[:1] == ["C"]:
                categories[fields[1]] = _category(fields[3], fields[5])
            elif fields[:1] == ["R"]:
                boxes += _room(fields)
            elif fields[:1] == ["O"]:
                boxes += _thing(fields, categories)
            within_limit(path, boxes)
        except (IndexError, ValueError) as error:
            raise FileFormatError(path, f"line {number} is damaged: {brief(str(error))}") from error
    if not boxes:
        raise FileFormatError(path, "contains neither rooms nor objects")
    corners = np.concatenate([box.corners() for box in boxes])
    if bounds is None or not (bounds[1] > bounds[0]).all():
        bounds = np.stack([corners.min(axis=0), corners.max(axis=0)])
    return House(boxes, bounds[0], bounds[1])


def _floats(fields: list[str], count: int) -> Array:
    if len(fields) != count:
        raise ValueError(f"{len(fields)} of {count} numbers: {' '.join(fields)}")
    values = np.array([float(f) for f in fields])
    if not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > 1e6:
        raise ValueError(f"numbers out of range: {' '.join(fields)}")
    return values


def _category(fine: str, coarse: str) -> str:
    fine, coarse = fine.replace("#", " ").strip().lower(), coarse.replace("_", " ").lower()
    if coarse in NOTHING and fine in NOTHING:
        return ""
    if coarse in STRUCTURE or fine in NOTHING:
        return coarse
    return category_of_name(fine) or coarse


def _room(fields: list[str]) -> list[LabelBox]:
    name = ROOMS.get(fields[5], "")
    lower, upper = _floats(fields[9:15], 6).reshape(2, 3)
    if not name or not (upper > lower).all():
        return []
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    return [LabelBox(f"Room_{fields[1]}", f"room:{name}", middle, np.eye(3), half)]


def _thing(fields: list[str], categories: dict[str, str]) -> list[LabelBox]:
    category = categories.get(fields[3], "")
    values = _floats(fields[4:16], 12)
    center, first, second, half = values[:3], values[3:6], values[6:9], values[9:12]
    axes = np.stack([first, second, np.cross(first, second)])
    length = np.linalg.norm(axes, axis=1)
    if not category or (length < 1e-6).any() or (half <= 0).all():
        return []
    half = np.abs(half)
    if category in STRUCTURE and category != "stairs" and half.min() > THIN:
        return []
    return [LabelBox(f"Object_{fields[1]}", category, center, axes / length[:, None], half)]
