"""The freemap of one level: where a robot's centre may be, and how far obstacles are."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

# Their parts, which take a second to import, come with their first use.
import scipy
import skimage

from ..core.arrays import F32, Array, Mask
from ..core.errors import SceneError
from . import FULL_HEIGHT_M
from .grid import GridSpec


@dataclass(frozen=True)
class Freemap:
    """Free space of one level.

    Attributes:
        floor_z_m: (rows, columns) float32 floor height [m]; NaN where there is no floor.
        traversable: (rows, columns) bool: floor, and nothing that a robot of up to
            `FULL_HEIGHT_M` could hit above the cell.
        headroom_m: (rows, columns) float32 height above the floor of the lowest thing that a robot
            could hit [m], infinite where there is none up to `FULL_HEIGHT_M`; (0, 0) in scenes
            repaired before there were headrooms.
    """

    grid: GridSpec
    floor_z_m: F32
    traversable: Mask
    headroom_m: F32 = field(default_factory=lambda: np.empty((0, 0), dtype=np.float32))

    def for_height(self, height_m: float) -> "Freemap":
        """Return the map of a robot that needs `height_m` [m] of free height.

        Low robots pass under tables. What only they can reach counts where it is connected with
        floor for all robots.

        Raises:
            SceneError: a height below `FULL_HEIGHT_M` in a scene without headrooms.
        """
        if height_m >= FULL_HEIGHT_M:
            return self
        if self.headroom_m.shape != self.traversable.shape:
            raise SceneError(
                "the scene was repaired by a version that recorded no free heights; repair it "
                f"again to plan for robots lower than {FULL_HEIGHT_M:g} m"
            )
        low = self.traversable | (np.isfinite(self.floor_z_m) & (self.headroom_m >= height_m))
        parts = np.asarray(skimage.measure.label(low, connectivity=1))
        reached = low & np.isin(parts, np.unique(parts[self.traversable]))
        return Freemap(self.grid, self.floor_z_m, reached, self.headroom_m)

    @cached_property
    def clearance_m(self) -> Array:
        """Return distances (rows, columns) [m] of cell centres to the nearest untraversable cell.

        The outside of the grid counts as untraversable. Measured to the blocked cell's edge.
        """
        padded = np.pad(self.traversable, 1)
        distance = np.asarray(scipy.ndimage.distance_transform_edt(padded))[1:-1, 1:-1]
        return np.maximum(distance - 0.5, 0.0) * self.grid.cell_m

    @cached_property
    def clearance_slope(self) -> Array:
        """Return the gradient (2, rows, columns) [m/m] of the clearance along x and y, blurred.

        It points away from the nearest obstacle; the blur makes it vanish smoothly on the centre
        lines of passages, where the clearance has a crease.
        """
        along_y, along_x = np.gradient(
            scipy.ndimage.gaussian_filter(self.clearance_m, 2.0), self.grid.cell_m
        )
        return np.stack([along_x, along_y])

    @cached_property
    def floor_z_everywhere_m(self) -> Array:
        """Return floor heights (rows, columns) [m], the nearest floor's where there is none."""
        index = scipy.ndimage.distance_transform_edt(
            ~np.isfinite(self.floor_z_m), return_distances=False, return_indices=True
        )
        return self.floor_z_m[tuple(np.asarray(index))].astype(np.float64)

    def free(self, radius_m: float) -> Mask:
        """Return (rows, columns) whether a disc of `radius_m` centred in the cell is free."""
        return self.traversable & (self.clearance_m >= radius_m)

    def traversable_on(self, grid: GridSpec) -> Mask:
        """Return `traversable` at the cell centres of another grid, (rows, columns) of that."""
        rows, columns = self.grid.under(grid)
        rows, columns = np.clip(rows, -1, self.grid.rows), np.clip(columns, -1, self.grid.columns)
        return np.pad(self.traversable, 1)[np.ix_(rows + 1, columns + 1)]
