"""Regular horizontal grids over a level."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import I64, Array, Mask


@dataclass(frozen=True)
class GridSpec:
    """A grid of square cells; arrays over it are indexed [row = y, column = x].

    Attributes:
        origin_xy_m: world (x, y) of the outer corner of cell (0, 0).
        cell_m: side of a cell.
        rows, columns: extent along y and x.
    """

    origin_xy_m: tuple[float, float]
    cell_m: float
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    def cell_of(self, xy_m: ArrayLike) -> I64:
        """Return (row, column) (..., 2) int64 of the cells that world points (..., 2) [m] lie in.

        Points outside the grid give indices outside `shape`; see `inside`.
        """
        xy = np.asarray(xy_m, dtype=np.float64)
        index = np.floor((xy - np.asarray(self.origin_xy_m)) / self.cell_m).astype(np.int64)
        return index[..., ::-1]

    def fractional_cell_of(self, xy_m: ArrayLike) -> Array:
        """Return (row, column) (..., 2) of points (..., 2) [m]: the inverse of `center_of`."""
        xy = np.asarray(xy_m, dtype=np.float64)
        return ((xy - np.asarray(self.origin_xy_m)) / self.cell_m - 0.5)[..., ::-1]

    def clamped_cell_of(self, xy_m: ArrayLike) -> I64:
        """Return (row, column) (..., 2) of the cells in the grid nearest to points (..., 2) [m]."""
        return np.clip(self.cell_of(xy_m), 0, np.array(self.shape) - 1)

    def center_of(self, row_column: ArrayLike) -> Array:
        """Return world centres (..., 2) [m] of (row, column) (..., 2), fractional allowed."""
        rc = np.asarray(row_column, dtype=np.float64)
        return np.asarray(self.origin_xy_m) + (rc[..., ::-1] + 0.5) * self.cell_m

    def inside(self, row_column: ArrayLike) -> Mask:
        """Return (...) whether (row, column) (..., 2) lies in the grid."""
        rc = np.asarray(row_column)
        return np.all((rc >= 0) & (rc < np.asarray(self.shape)), axis=-1)

    def under(self, grid: "GridSpec") -> tuple[I64, I64]:
        """Return the row here under the centre of each row of another grid, and so the columns.

        Centres outside give indices outside `shape`.
        """
        rows = np.stack([np.arange(grid.rows), np.zeros(grid.rows)], axis=-1)
        columns = np.stack([np.zeros(grid.columns), np.arange(grid.columns)], axis=-1)
        row = self.cell_of(grid.center_of(rows))[:, 0]
        return row, self.cell_of(grid.center_of(columns))[:, 1]

    @staticmethod
    def covering(lower_xy_m: ArrayLike, upper_xy_m: ArrayLike, cell_m: float) -> "GridSpec":
        """Return the grid aligned to multiples of `cell_m` that covers a box (2,), (2,) [m]."""
        lower = np.floor(np.asarray(lower_xy_m, dtype=np.float64) / cell_m)
        upper = np.ceil(np.asarray(upper_xy_m, dtype=np.float64) / cell_m)
        columns, rows = np.maximum(upper - lower, 1).astype(int)
        return GridSpec(
            (float(lower[0] * cell_m), float(lower[1] * cell_m)), cell_m, int(rows), int(columns)
        )
