"""Find where a path passes from one room into another."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.arrays import I32, I64, Array
from ..formats.core.geometry import arc_length, onward, path_length, point_along
from .regions import RegionMap

DOORWAY_M = 1.8  # a passage between rooms at most this wide is called a doorway
# Two crossings at most this far apart go through one and the same passage.
_SAME_DOOR_M = 0.6
# A path must go this far behind a door for its end to be in the next room.
_BEHIND_DOOR_M = 0.4
# Or only so far, where the straight line onward settles in it.
_BEHIND_FRAME_M, _BEYOND_M = 0.12, 0.5


@dataclass(frozen=True)
class Crossing:
    """A path's step from one room into another.

    Attributes:
        along_m, position_xy_m: distance along the path [m], and place (2,) [m].
        from_region, to_region: room index before and after.
        width_m: width of the passage at its narrowest within half a metre [m].
    """

    along_m: float
    position_xy_m: Array
    from_region: int
    to_region: int
    width_m: float


def crossings(regions: RegionMap, path_m: ArrayLike, settle_m: float = 1.0) -> list[Crossing]:
    """Return where a path (P, 2 or 3) [m] passes from one room into another, in order.

    A visit shorter than `settle_m` is no visit: brushing past a corner of another room, or the
    ragged border of two, is not reported.
    """
    path = np.asarray(path_m, dtype=np.float64)[:, :2]
    length = arc_length(path)[-1]
    along = np.linspace(0.0, length, max(2, int(np.ceil(length / 0.05)) + 1))
    points = point_along(path, along)
    rooms = regions.at(points)
    cells = regions.grid.clamped_cell_of(points)
    widths = regions.width_m[cells[:, 0], cells[:, 1]]
    edges = np.flatnonzero(np.diff(rooms)) + 1
    runs = np.split(np.arange(len(rooms)), edges)
    settled = [run for run in runs if _settled(run, rooms, along, widths, settle_m)]
    result: list[Crossing] = []
    for before, after in pairwise(settled):
        old, new = int(rooms[before[0]]), int(rooms[after[0]])
        if old == new:
            continue
        at = (before[-1] + after[0]) // 2
        near = np.abs(along - along[at]) <= 0.5
        k = int(np.flatnonzero(near)[np.argmin(widths[near])])
        if result and along[k] - result[-1].along_m < _SAME_DOOR_M:
            # Both borders belong to one passage: a single step from the first room to the last.
            old, k = result[-1].from_region, int(np.searchsorted(along, result[-1].along_m))
            result.pop()
        if old != new:
            result.append(Crossing(float(along[k]), points[k], old, new, float(widths[k])))
    return result


def crossings_to_the_ends(regions: RegionMap, path_m: ArrayLike) -> list[Crossing]:
    """Return the crossings of a path that may start or end in a doorway.

    Both ends are drawn out by half a metre: who stands just behind a frame is in the room behind
    it, wherever the map draws the border of the two.
    """
    path = np.asarray(path_m, dtype=np.float64)[:, :2]
    before, after = (onward(p, _BEYOND_M)[-1] for p in (path[::-1], path))
    drawn_out = crossings(regions, np.vstack([before, path, after]))
    crossed = [replace(c, along_m=c.along_m - _BEYOND_M) for c in drawn_out]
    last_m = path_length(path) - _BEHIND_FRAME_M
    return [c for c in crossed if _BEHIND_FRAME_M <= c.along_m <= last_m]


def _settled(run: I64, rooms: I32, along: Array, widths: Array, settle_m: float) -> bool:
    """Return whether the samples `run` of a path are a visit to their room."""
    if rooms[run[0]] < 0:
        return False
    stay = float(along[run[-1]] - along[run[0]])
    if stay >= settle_m:
        return True
    # A path may end just behind a door; the border of an open space is not that certain.
    if run[0] != 0 and run[-1] != len(rooms) - 1:
        return False
    border = along[run[0]] if run[0] else along[run[-1]]
    narrowest = widths[np.abs(along - border) <= 0.5].min()
    return stay >= _BEHIND_DOOR_M and narrowest <= DOORWAY_M
