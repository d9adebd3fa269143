"""The openings between the rooms of a level, and which of them are doorways."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from skimage.measure import label

from ...formats.scene.bundle import LabeledObject
from ...wayfinding.regions import RegionMap
from ..language.nouns import noun_of

DOOR, OPENING = "doorway", "opening"
# A wider opening is no doorway, without a door leaf and with one.
_DOOR_M, _HUNG_M = 1.6, 2.5
_JOIN_CELLS, _LEAST_CELLS = 3, 3
_AT_M = 0.7  # who turns in a doorway is so far from it
_LEAF_M = 0.3  # a leaf hangs this near to its opening
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Opening:
    """Where rooms meet; several may meet in one.

    Attributes:
        rooms: their indices.
        low_m, high_m: its box (2,) [m].
        noun: `DOOR` or `OPENING`.
    """

    rooms: tuple[int, ...]
    low_m: Array
    high_m: Array
    noun: str

    @property
    def middle_m(self) -> Array:
        """Its middle (2,) [m]."""
        return 0.5 * (self.low_m + self.high_m)

    def distance_m(self, xy_m: Array) -> float:
        """Return how far a place (2,) [m] is from it."""
        return float(np.linalg.norm(np.clip(xy_m, self.low_m, self.high_m) - xy_m))

    def is_at(self, xy_m: Array, *rooms: int) -> bool:
        """Return whether it joins the rooms right at a place (2,) [m]."""
        return set(rooms).issubset(self.rooms) and self.distance_m(xy_m) <= _AT_M

    def is_ahead(self, heading_rad: float) -> bool:
        """Return whether it is plainly in a wall across a heading, not in one along it."""
        heading = np.abs((np.cos(heading_rad), np.sin(heading_rad)))
        size_m = self.high_m - self.low_m
        return bool(heading @ size_m[::-1] > 2.0 * (heading @ size_m))


def find_openings(regions: RegionMap, leaves: Sequence[LabeledObject] = ()) -> list[Opening]:
    """Return the openings of a level, in some of which door leaves hang."""
    cells, pairs = _borders(regions)
    border = np.zeros(regions.region.shape, dtype=bool)
    border[cells[:, 0], cells[:, 1]] = True
    parts = np.asarray(label(binary_dilation(border, iterations=_JOIN_CELLS), connectivity=2))
    part = parts[cells[:, 0], cells[:, 1]]
    xy_m = regions.grid.center_of(cells)
    result = []
    for number in np.unique(part):
        here = part == number
        if here.sum() < _LEAST_CELLS:
            continue
        low, high = xy_m[here].min(0), xy_m[here].max(0)
        sizes = [np.ptp(xy_m[here & (pairs == pair).all(1)], axis=0)
                 for pair in np.unique(pairs[here], axis=0)]  # fmt: skip
        hung = any(_at(leaf, low, high) for leaf in leaves)
        wide_m = max(float(np.hypot(*size)) for size in sizes)
        narrow = wide_m <= (_HUNG_M if hung else _DOOR_M)
        rooms = tuple(np.unique(pairs[here]).tolist())
        result.append(Opening(rooms, low, high, DOOR if narrow else OPENING))
    return result


def shut_doors(leaves: Sequence[LabeledObject], openings: Sequence[Opening]) -> list[LabeledObject]:
    """Return the doors that fill no opening, as a front door does: people count them.

    Of two leaves side by side, or a leaf and its frame, one stands for both.
    """
    shut: list[LabeledObject] = []
    taken = [(o.low_m, o.high_m) for o in openings]
    for leaf in leaves:
        if not any(_at(leaf, low, high) for low, high in taken):
            shut.append(leaf)
            taken.append((np.array(leaf.lower_m[:2]), np.array(leaf.upper_m[:2])))
    return shut


def is_door(thing: LabeledObject) -> bool:
    """Return whether an object is a door's leaf or its frame."""
    return noun_of(thing.category) == "door"


def _at(leaf: LabeledObject, low_m: Array, high_m: Array) -> bool:
    low, high = np.array(leaf.lower_m[:2]), np.array(leaf.upper_m[:2])
    return bool(((low <= high_m + _LEAF_M) & (high >= low_m - _LEAF_M)).all())


def as_thing(opening: Opening, number: int, level: int, floor_z_m: float) -> LabeledObject:
    """Return an opening as an object of a level."""
    low, high = ((float(x), float(y)) for x, y in (opening.low_m, opening.high_m))
    return LabeledObject(
        f"{opening.noun}-{number}", opening.noun,
        (*low, floor_z_m), (*high, floor_z_m + 2.0), level,
    )  # fmt: skip


def _borders(regions: RegionMap) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the open cells (K, 2) where two rooms meet, and the rooms (K, 2) that meet there."""
    room = regions.region
    cells, pairs = [], []
    for axis in (0, 1):
        a = np.take(room, range(room.shape[axis] - 1), axis)
        b = np.take(room, range(1, room.shape[axis]), axis)
        at = np.argwhere((a != b) & (a >= 0) & (b >= 0))
        at = at[regions.width_m[at[:, 0], at[:, 1]] > 0]
        cells.append(at)
        pairs.append(np.stack([a[at[:, 0], at[:, 1]], b[at[:, 0], at[:, 1]]], axis=1))
    return np.concatenate(cells), np.sort(np.concatenate(pairs), axis=1)
