"""The floor as a height field: smoothed, and extended to all cells."""

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import Array
from ...formats.scene.bundle import Floor
from ...formats.scene.grid import GridSpec
from .morphology import nearest_in

# Steps larger than this are real edges (platforms, sunken areas) and stay sharp.
EDGE_M = 0.03


def coarse_floor(fine: GridSpec, z_m: Array, grid: GridSpec) -> Floor:
    """Average a fine floor (NaN = none) over the cells of `grid` and extend it outside.

    Cells of `grid` are a whole multiple of the fine ones; both have one origin.
    """
    factor = round(grid.cell_m / fine.cell_m)
    blocks = z_m.reshape(grid.rows, factor, grid.columns, factor).swapaxes(1, 2)
    blocks = blocks.reshape(grid.rows, grid.columns, factor * factor)
    counted = np.isfinite(blocks).sum(axis=2)
    # A cell counts only whole, so nothing dropped inside it falls through.
    covered = counted == factor * factor
    total = np.nansum(blocks, axis=2)
    height = np.where(counted > 0, total / np.maximum(counted, 1), np.nan)
    height = extend(smooth(height))
    return Floor(grid, height.astype(np.float32), covered)


def smooth(height_m: Array) -> Array:
    """Return means over 5 × 5 cells within `EDGE_M` of each height (bilateral); NaN stays."""
    finite = np.isfinite(height_m)
    padded = np.pad(np.where(finite, height_m, np.nan), 2, constant_values=np.nan)
    total = np.zeros_like(height_m)
    weight = np.zeros_like(height_m)
    rows, columns = height_m.shape
    for i in range(5):
        for j in range(5):
            near = padded[i : i + rows, j : j + columns]
            alike = np.abs(near - height_m) <= EDGE_M
            total += np.where(alike, near, 0.0)
            weight += alike
    return np.where(finite, total / np.maximum(weight, 1), np.nan)


def extend(height_m: Array) -> Array:
    """Give every NaN cell the height of the nearest known one, of which there is at least one."""
    finite = np.isfinite(height_m)
    if not finite.any():
        raise ValueError("a height field needs at least one known cell")
    return height_m[nearest_in(finite)]


def heights_at(height_m: Array, grid: GridSpec, xy_m: Array) -> Array:
    """Return heights (N,) at points (N, 2), bilinear between the centres of cells."""
    position = (xy_m - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
    return ndimage.map_coordinates(height_m, position[:, ::-1].T, order=1, mode="nearest")
