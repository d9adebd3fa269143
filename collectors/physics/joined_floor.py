"""The floors of two levels and the staircase between them, as physics sees them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import Array, Mask
from ...formats.scene.bundle import Floor, SceneBundle
from .floor_surface import FloorSurface

# Ground this far above or below a place or a robot's feet is another storey, or a hole that the
# robot keeps out of: more than two steps, and less than half a storey.
STOREY_M = 0.7


@dataclass(frozen=True)
class JoinedFloor:
    """Heights of two floors and of the treads between, one above the other.

    A point is on the sheet whose height is near to that of the ground which is asked for; treads
    come before what lies below or above them.
    """

    lower: FloorSurface
    upper: FloorSurface
    stairs: Floor

    @staticmethod
    def of(bundle: SceneBundle, staircase: int) -> "JoinedFloor":
        """Load the floors that a staircase joins.

        Raises:
            ValueError: no such staircase, or nobody can climb it.
            FileFormatError: the scene's files are missing or damaged.
        """
        stairs = bundle.stair_floor(staircase)
        lower, upper = (FloorSurface(bundle.floor(k)) for k in bundle.staircases[staircase].levels)
        return JoinedFloor(lower, upper, stairs)

    def height_at(self, xy_m: ArrayLike, near_z_m: ArrayLike) -> Array:
        """Return the floor height (...) [m] under points (..., 2) [m], near to heights (...) [m].

        Levels are bilinear between cells, and treads end sharply at the border of a cell.
        """
        xy = np.asarray(xy_m, dtype=np.float64)
        near = np.broadcast_to(np.asarray(near_z_m, dtype=np.float64), xy.shape[:-1])
        on_stairs, tread = _covered(self.stairs, self.stairs.covered, xy)
        lower, upper = self._level(self.lower, xy), self._level(self.upper, xy)
        # Where one level has no floor, the other one may.
        away = [np.abs(z - near) + np.where(solid, 0.0, 1000.0) for solid, z in (lower, upper)]
        level = np.where(away[0] <= away[1], lower[1], upper[1])
        return np.where(on_stairs & (np.abs(tread - near) < STOREY_M), tread, level)

    def is_solid(self, x_m: float, y_m: float, near_z_m: float) -> bool:
        """Return whether there is floor to stand on at a point and near to a height [m]."""
        xy = np.array([x_m, y_m])
        sheets = (
            _covered(self.stairs, self.stairs.covered, xy),
            self._level(self.lower, xy),
            self._level(self.upper, xy),
        )
        return any(bool(solid) and abs(float(z) - near_z_m) < STOREY_M for solid, z in sheets)

    def _level(self, level: FloorSurface, xy: Array) -> tuple[Mask, Array]:
        """Return whether a level has floor at points (..., 2), and its height there, both (...).

        Over the stairs no floor reaches beyond the cells that are covered.
        """
        on_stairs, _ = _covered(self.stairs, self.stairs.covered, xy)
        whole, _ = _covered(level.floor, level.floor.covered, xy)
        wide, _ = _covered(level.floor, level.solid, xy)
        return np.where(on_stairs, whole, wide), level.height_at(xy)


def _covered(floor: Floor, cells: Mask, xy_m: Array) -> tuple[Mask, Array]:
    """Return whether points (..., 2) lie in marked cells, and the heights of theirs, both (...)."""
    grid = floor.grid
    cell = grid.cell_of(xy_m)
    at = tuple(np.moveaxis(grid.clamped_cell_of(xy_m), -1, 0))
    return grid.inside(cell) & cells[at], floor.height_m[at].astype(np.float64)
