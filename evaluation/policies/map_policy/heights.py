"""What a robot has seen at each height, and where it could step from where it stands."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ....formats.core.frames import Array
from ....formats.scene.grid import GridSpec

Mask = NDArray[np.bool_]
CELL_M = 0.1
SLICE_M = 0.05
_REACH_M = 3.6  # heights above and below the floor that are kept
_SLICES = round(2 * _REACH_M / SLICE_M)
_FREE_SLICES = round(0.6 / SLICE_M)  # free above whatever a robot stands on
_STEP_SLICES = 5  # the highest step, and what rounding adds
# From below only risers are seen, and they lie a tread apart.
_STRIDE_CELLS = 4


@dataclass
class Heights:
    """Points seen by cell and height above a level's floor.

    Attributes:
        grid: cells, those of the map.
        filled: (R, C, Z) bool.
    """

    grid: GridSpec
    filled: Mask = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Begin with nothing seen."""
        self.filled = np.zeros((*self.grid.shape, _SLICES), bool)

    def add(self, points_m: Array) -> None:
        """Add points (N, 3) [m] above the level's floor."""
        z = np.floor((points_m[:, 2] + _REACH_M) / SLICE_M).astype(np.int64)
        cells = self.grid.cell_of(points_m[:, :2])
        inside = self.grid.inside(cells) & (z >= 0) & (z < _SLICES)
        self.filled[cells[inside, 0], cells[inside, 1], z[inside]] = True

    def between(self, low_m: Array, high_m: Array, cells: NDArray[np.int64]) -> Mask:
        """Return whether (N,) something is between two heights (N,) [m] in cells (N, 2)."""
        z = (np.arange(_SLICES) + 0.5) * SLICE_M - _REACH_M
        inside = (z > low_m[:, None]) & (z < high_m[:, None])
        rows, columns = np.clip(cells, 0, np.array(self.grid.shape) - 1).T
        return np.asarray(
            (self.filled[rows, columns] & inside).any(axis=1) & self.grid.inside(cells)
        )

    def steps(self, from_xy_m: Array, floor_m: float, radius_m: float) -> Array:
        """Return the places (N, 3) [m] to which steps lead from a place (2,) on a floor [m].

        A place is the top of what has been seen in a cell, with free height above it and no face
        below it that is higher than a riser: walls and fronts of furniture have no places.

        Args:
            radius_m: how far to look.
        """
        row, column = self.grid.cell_of(from_xy_m)
        reach = round(radius_m / CELL_M)
        low = np.maximum((row - reach, column - reach), 0)
        high = np.maximum((row + reach + 1, column + reach + 1), 0)
        filled = self.filled[low[0] : high[0], low[1] : high[1]]
        tops = filled & ~_under_or_on_a_face(filled)
        start = round((floor_m + _REACH_M) / SLICE_M)
        cells = _grown(tops, np.array((row, column)) - low, start)
        xy = self.grid.center_of(cells[:, :2] + low)
        return np.column_stack([xy, (cells[:, 2] + 0.5) * SLICE_M - _REACH_M]).astype(np.float64)


def _under_or_on_a_face(filled: Mask) -> Mask:
    """Return (R, C, Z) where something is above, or a high face below."""
    count = np.cumsum(filled, axis=2, dtype=np.int16)
    here = np.arange(_SLICES)
    above = count[:, :, np.minimum(here + _FREE_SLICES, _SLICES - 1)] - count
    low = count[:, :, np.maximum(here - _STEP_SLICES, 0)]
    face = low - count[:, :, np.maximum(here - _STEP_SLICES - 2, 0)]
    return np.asarray((above > 0) | (face > 0))


def _grown(tops: Mask, start_cell: NDArray[np.int64], start_slice: int) -> NDArray[np.int64]:
    """Return rows, columns and slices (N, 3) of the tops to which steps lead."""
    z = np.full(tops.shape[:2], -1, np.int64)
    near = np.argwhere(tops)
    seeds = near[
        (np.abs(near[:, 2] - start_slice) <= 2)
        & (np.linalg.norm(near[:, :2] - start_cell, axis=1) <= 12)
    ]
    z[seeds[:, 0], seeds[:, 1]] = seeds[:, 2]
    span = np.arange(-_STRIDE_CELLS, _STRIDE_CELLS + 1)
    offsets = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    offsets = offsets[np.linalg.norm(offsets, axis=1) <= _STRIDE_CELLS]
    rises = np.array(sorted(range(-_STEP_SLICES, _STEP_SLICES + 1), key=abs))
    edge = np.argwhere(z >= 0)
    while len(edge):
        height = np.repeat(z[edge[:, 0], edge[:, 1]], len(offsets))
        cells = (edge[:, None] + offsets).reshape(-1, 2)
        inside = np.all((cells >= 0) & (cells < z.shape), axis=1)
        cells, height = cells[inside], height[inside]
        new = z[cells[:, 0], cells[:, 1]] < 0
        cells, height = cells[new], height[new]
        heights = np.clip(height[:, None] + rises, 0, _SLICES - 1)
        is_top = tops[cells[:, :1], cells[:, 1:], heights]
        has_top = is_top.any(axis=1)
        cells, best = cells[has_top], np.argmax(is_top[has_top], axis=1)
        z[cells[:, 0], cells[:, 1]] = heights[has_top][np.arange(len(best)), best]
        edge = np.unique(cells, axis=0)
    rows, columns = np.nonzero(z >= 0)
    return np.column_stack([rows, columns, z[rows, columns]])
