"""The floor of a level as physics sees it: a surface, and where there is none."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from ...formats.core.arrays import Array, Mask
from ...formats.scene.bundle import Floor

# Walls stand on cells that no scan covers; feet next to a wall must not fall into a crack there.
SKIRT_M = 0.3


@dataclass(frozen=True)
class FloorSurface:
    """Heights of a floor, extended by `SKIRT_M` around the covered cells."""

    floor: Floor

    @cached_property
    def solid(self) -> Mask:
        """(rows, columns) bool: covered, or within `SKIRT_M` of a covered cell."""
        covered = self.floor.covered
        if covered.all():
            return covered
        gap = np.asarray(distance_transform_edt(~covered)) * self.floor.grid.cell_m
        return gap <= SKIRT_M

    def height_at(self, xy_m: ArrayLike, near_z_m: ArrayLike = 0.0) -> Array:
        """Return the floor height (...) [m] under points (..., 2) [m], bilinear between cells.

        Whatever `near_z_m` is: only a `JoinedFloor` has several heights at a point.
        """
        grid = self.floor.grid
        xy = np.asarray(xy_m, dtype=np.float64)
        at = (xy - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
        last = np.array([grid.columns - 1, grid.rows - 1])
        at = np.clip(at, 0, last)
        low = np.minimum(at.astype(np.int64), np.maximum(last - 1, 0))
        high = np.minimum(low + 1, last)
        fx, fy = np.moveaxis(at - low, -1, 0)
        h = self.floor.height_m.astype(np.float64)
        (x0, y0), (x1, y1) = np.moveaxis(low, -1, 0), np.moveaxis(high, -1, 0)
        near = h[y0, x0] * (1 - fx) + h[y0, x1] * fx
        far = h[y1, x0] * (1 - fx) + h[y1, x1] * fx
        return near * (1 - fy) + far * fy

    def is_solid(self, x_m: float, y_m: float, near_z_m: float = 0.0) -> bool:
        """Return whether there is floor to stand on at a point [m]; false outside the grid."""
        grid = self.floor.grid
        column = int((x_m - grid.origin_xy_m[0]) // grid.cell_m)
        row = int((y_m - grid.origin_xy_m[1]) // grid.cell_m)
        inside = 0 <= row < grid.rows and 0 <= column < grid.columns
        return inside and bool(self.solid[row, column])
