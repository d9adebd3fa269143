"""On which level of a scene points lie, by their height above the floors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.freemap import Freemap
from ...wayfinding.distance import nearest_cell
from ...wayfinding.planning import floor_z

Array = NDArray[np.float64]

FLOOR_REACH_M = 0.5  # floor this far from a point still counts as the floor under it


def floor_gaps(freemap: Freemap, points_m: Array) -> Array:
    """Return the height of points (P, 3) [m] above a level's floor (P,).

    Inf where there is none nearby.
    """
    known = np.isfinite(freemap.floor_z_m)
    if not known.any():
        return np.full(len(points_m), np.inf)
    gaps = points_m[:, 2] - floor_z(freemap, points_m[:, :2])
    cells = [nearest_cell(freemap.grid, known, p, FLOOR_REACH_M) for p in points_m[:, :2]]
    return np.where([cell is not None for cell in cells], gaps, np.inf)


def level_gaps(freemaps: Sequence[Freemap], points_m: Array) -> Array:
    """Return `floor_gaps` of points (P, 3) [m] to every level: (levels, P)."""
    return np.array([floor_gaps(freemap, points_m) for freemap in freemaps])
