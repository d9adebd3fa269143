"""The floor as a height field: smoothed, and extended to all cells."""

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.bundle import Floor
from ...formats.scene.grid import GridSpec
from ..grid.morphology import nearest_in

# Steps larger than this are real edges (platforms, sunken areas) and stay sharp.
EDGE_M = 0.03


def coarse_floor(fine: GridSpec, z_m: NDArray[np.float64], grid: GridSpec) -> Floor:
    """Average a fine floor (NaN = none) over the cells of `grid` and extend it outside.

    Args:
        fine: the fine cells; `grid.cell_m` is a whole multiple of `fine.cell_m`, same origin.
        z_m: (fine rows, fine columns) heights.
        grid: the coarse cells.
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


def smooth(height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average heights over 5 × 5 cells among cells that lie within `EDGE_M`; NaN stays NaN.

    One round of a bilateral mean: noise goes, real steps stay.
    """
    known = np.isfinite(height_m)
    padded = np.pad(np.where(known, height_m, np.nan), 2, constant_values=np.nan)
    total = np.zeros_like(height_m)
    weight = np.zeros_like(height_m)
    rows, columns = height_m.shape
    for i in range(5):
        for j in range(5):
            near = padded[i : i + rows, j : j + columns]
            alike = np.abs(near - height_m) <= EDGE_M
            total += np.where(alike, near, 0.0)
            weight += alike
    return np.where(known, total / np.maximum(weight, 1), np.nan)


def extend(height_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give every NaN cell the height of the nearest known cell.

    Raises:
        ValueError: no cell is known.
    """
    known = np.isfinite(height_m)
    if not known.any():
        raise ValueError("a height field needs at least one known cell")
    return height_m[nearest_in(known)]
