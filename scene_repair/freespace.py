"""Where air is and where it is not: solid insides, and the planning map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .maps import label
from .voxels import STEPS, Voxels

# Air over at least this much connected free floor is a place; smaller pockets are insides.
MIN_PLACE_M2 = 0.5


def blocked_cells(
    voxels: Voxels, height_m: NDArray[np.float64], above_m: float
) -> NDArray[np.bool_]:
    """(rows, columns) cells over which something rises more than `above_m` over the floor."""
    side = voxels.grid.cell_m
    layers = voxels.upper.shape[2]
    bottom = voxels.z0_m + side * np.arange(layers)
    top = bottom + side * (voxels.upper[..., 2] / STEPS)
    return np.any(voxels.occupied & (top > height_m[..., None] + above_m), axis=2)


def solid_inside(
    voxels: Voxels, free_floor: NDArray[np.bool_], height_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Occupied voxels plus all air that neither a place nor the outside reaches.

    The inside of walls, cupboards and mattresses becomes solid: fewer boxes, and no thin shells
    that a foot could tunnel into.

    Args:
        voxels: surfaces above the floor.
        free_floor: (rows, columns) floor with nothing above it.
        height_m: (rows, columns) floor height.
    """
    side = voxels.grid.cell_m
    occupied = voxels.occupied
    layers = occupied.shape[2]
    center = voxels.z0_m + side * (np.arange(layers) + 0.5)
    ground = center[None, None, :] < height_m[..., None]
    parts, count = label(~occupied & ~ground)
    place, places = label(free_floor)
    area = np.bincount(place.ravel(), minlength=places + 1) * side**2
    roomy = (area >= MIN_PLACE_M2) & (np.arange(places + 1) > 0)
    air = np.zeros(count + 1, dtype=bool)
    air[np.unique(parts[roomy[place]])] = True
    for border in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        air[np.unique(border)] = True
    air[0] = False
    return ~air[parts] & ~ground
