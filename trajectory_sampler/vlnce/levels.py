"""On which level of a scene points lie, by their height above the floors."""

from collections.abc import Sequence

import numpy as np

from ...formats.core.frames import Array
from ...formats.scene.freemap import Freemap
from ...wayfinding.distance import nearest_cell
from ...wayfinding.planning import floor_z

FLOOR_REACH_M = 0.5  # floor this far from a point still counts as the floor under it


def level_gaps(freemaps: Sequence[Freemap], points_m: Array) -> Array:
    """Return the heights (levels, P) of points (P, 3) [m] above every level's floor [m].

    A height is infinite where the level has no floor nearby.
    """
    return np.array([_floor_gaps(freemap, points_m) for freemap in freemaps])


def _floor_gaps(freemap: Freemap, points_m: Array) -> Array:
    has_floor = np.isfinite(freemap.floor_z_m)
    if not has_floor.any():
        return np.full(len(points_m), np.inf)
    gaps = points_m[:, 2] - floor_z(freemap, points_m[:, :2])
    cells = [nearest_cell(freemap.grid, has_floor, p, FLOOR_REACH_M) for p in points_m[:, :2]]
    return np.where([cell is not None for cell in cells], gaps, np.inf)
