"""A coarse grid of ambient cubes over a scene: values per cell and axis direction.

One number per cell and axis direction (McTaggart, "Half-Life 2 / Valve Source shading", 2004),
read by kernels with a trilinear look-up weighted by the squares of the normal.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter

from ...formats.core.arrays import F32, U16, Floats

f32 = np.float32

CELL_M = 0.2
MAX_CELLS = 300_000
# In the order of the grid's last axis.
AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)


class CubeGrid(NamedTuple):
    """Values at the centres of cells, per axis direction.

    Attributes:
        cube: (Z, Y, X, 8) uint16, at least 2 cells each way; directions +x, −x, +y, −y, +z, −z,
            and two zeros, so that a cell is one load.
        lower_m: (3,) float32 centre of cell (0, 0, 0).
        per_m: cells per metre.
        scale: value of one step.
    """

    cube: U16
    lower_m: F32
    per_m: np.float32
    scale: np.float32


def constant_grid(value: float) -> CubeGrid:
    """Return a grid with the same value everywhere."""
    cube = np.full((2, 2, 2, 8), 65535, dtype=np.uint16)
    return CubeGrid(cube, np.zeros(3, dtype=f32), f32(1.0), f32(value / 65535))


def cell_centers(vertices: F32) -> tuple[F32, CubeGrid]:
    """Return cell centres (Z, Y, X, 3) over the bounds of vertices (V, 3) and their empty grid.

    Cells are `CELL_M` wide, or wider if more than `MAX_CELLS` would be needed.
    """
    lower, upper = vertices.min(0).astype(np.float64), vertices.max(0).astype(np.float64)
    cell = max(CELL_M, float((np.prod(upper - lower + CELL_M) / MAX_CELLS) ** (1 / 3)))
    counts = np.maximum(np.ceil((upper - lower) / cell).astype(int), 2)
    first = 0.5 * (lower + upper) - 0.5 * (counts - 1) * cell
    x, y, z = (first[k] + cell * np.arange(counts[k]) for k in range(3))
    z, y, x = np.meshgrid(z, y, x, indexing="ij")
    empty = np.zeros((*x.shape, 8), dtype=np.uint16)
    grid = CubeGrid(empty, first.astype(f32), f32(1.0 / cell), f32(1.0))
    return np.stack([x, y, z], axis=-1).astype(f32), grid


def filled(grid: CubeGrid, values: Floats, top: float) -> CubeGrid:
    """Return `grid` with values (Z, Y, X, 6) from 0 to `top`."""
    cube = np.zeros_like(grid.cube)
    cube[..., :6] = np.round(np.clip(values / top, 0.0, 1.0) * 65535.0)
    return grid._replace(cube=cube, scale=f32(top / 65535.0))


def inpainted(values: Floats, *, trust: Floats) -> Floats:
    """Replace values of cells inside furniture and walls by those of the cells around them.

    Args:
        values: (Z, Y, X, K).
        trust: (Z, Y, X) from 0 (inside objects) to 1 (free).
    """
    spread = gaussian_filter(trust, 0.8, mode="nearest")
    mean = np.stack(
        [
            gaussian_filter(values[..., k] * trust, 0.8, mode="nearest") / spread
            for k in range(values.shape[-1])
        ],
        axis=-1,
    )
    return trust[..., None] * values + (1.0 - trust[..., None]) * mean
