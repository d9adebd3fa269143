"""The doorways of a level, from where its rooms meet."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from skimage.measure import label

from ...formats.scene.bundle import LabeledObject
from ...wayfinding.crossings import DOORWAY_M
from ...wayfinding.regions import RegionMap

DOOR = "doorway"
_JOIN_CELLS = 3


def doorways(regions: RegionMap, level: int, floor_z_m: float) -> list[LabeledObject]:
    """Return the passages between two rooms that are no wider than a doorway."""
    border = _borders(regions) & (regions.width_m <= DOORWAY_M)
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


def rooms_met(
    regions: RegionMap,
    names: Sequence[str],
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
) -> tuple[str, ...]:
    """Return the names of the rooms that meet in a doorway's box `low_m` … `high_m` (2,) [m]."""
    xs, ys = (
        np.arange(a - regions.grid.cell_m, b + 1.5 * regions.grid.cell_m, regions.grid.cell_m)
        for a, b in zip(low_m, high_m, strict=True)
    )
    found = np.unique(regions.at(np.stack(np.meshgrid(xs, ys), axis=-1)))
    met: set[str] = {str(names[k]) for k in found.tolist() if k >= 0}
    return tuple(sorted(met - {""}))


def openings_of(regions: RegionMap) -> tuple[tuple[tuple[int, ...], ...], ...]:
    """Return for each room its openings, each as the rooms behind it.

    An opening is a doorway or a wider passage; several rooms may meet in one.
    """
    border = _borders(regions)
    parts = np.asarray(label(_grown(border), connectivity=2))
    meeting: dict[int, set[int]] = {}
    for room in range(len(regions.names)):
        beside = border & _grown(regions.region == room, 1)
        for part in np.unique(parts[beside]).tolist():
            meeting.setdefault(part, set()).add(room)
    return tuple(
        tuple(
            tuple(sorted(rooms - {room})) for _, rooms in sorted(meeting.items()) if room in rooms
        )
        for room in range(len(regions.names))
    )


def _borders(regions: RegionMap) -> NDArray[np.bool_]:
    """Return the open cells (R, C) where two rooms meet."""
    room = regions.region
    border = np.zeros(room.shape, dtype=bool)
    for axis in (0, 1):
        a = np.take(room, range(room.shape[axis] - 1), axis)
        b = np.take(room, range(1, room.shape[axis]), axis)
        border[np.nonzero((a != b) & (a >= 0) & (b >= 0))] = True
    return border & (regions.width_m > 0)


def _grown(mask: NDArray[np.bool_], cells: int = _JOIN_CELLS) -> NDArray[np.bool_]:
    return np.asarray(binary_dilation(mask, iterations=cells))
