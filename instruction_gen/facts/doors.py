"""The doorways of a level, from where its rooms meet."""

from __future__ import annotations

import numpy as np
from skimage.measure import label

from ...formats.scene.bundle import LabeledObject
from ...wayfinding.crossings import DOORWAY_M
from ...wayfinding.regions import RegionMap

DOOR = "doorway"
_JOIN_CELLS = 3


def doorways(regions: RegionMap, level: int, floor_z_m: float) -> list[LabeledObject]:
    """Passages between two rooms that are no wider than a doorway."""
    room, width = regions.region, regions.width_m
    border = np.zeros(room.shape, dtype=bool)
    for axis in (0, 1):
        a = np.take(room, range(room.shape[axis] - 1), axis)
        b = np.take(room, range(1, room.shape[axis]), axis)
        meets = (a != b) & (a >= 0) & (b >= 0)
        index = np.nonzero(meets)
        border[index] = True
    border &= (width > 0) & (width <= DOORWAY_M)
    parts = np.asarray(label(_grown(border), connectivity=2))
    result = []
    for k in range(1, int(parts.max(initial=0)) + 1):
        cells = np.argwhere(border & (parts == k))
        if len(cells) < 3:
            continue
        low, high = regions.grid.center_of(cells).min(0), regions.grid.center_of(cells).max(0)
        result.append(
            LabeledObject(
                f"doorway-{len(result) + 1}",
                DOOR,
                (float(low[0]), float(low[1]), floor_z_m),
                (float(high[0]), float(high[1]), floor_z_m + 2.0),
                level,
            )
        )
    return result


def _grown(mask: np.ndarray) -> np.ndarray:
    grown = mask.copy()
    for _ in range(_JOIN_CELLS):
        padded = np.pad(grown, 1)
        grown = (
            padded[1:-1, 1:-1] | padded[:-2, 1:-1] | padded[2:, 1:-1] | padded[1:-1, :-2]
            | padded[1:-1, 2:]
        )  # fmt: skip
    return grown
