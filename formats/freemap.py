"""The planning map of one level: where a robot's centre may be, and geodesic distance on it.

It lies in `formats` because both the sampler (which plans episodes) and the collectors (which
re-plan, and measure NE, OS and SPL by geodesic distance) need it, and rooms never import a
neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt
from skimage.graph import MCP_Geometric

from .grid import GridSpec


@dataclass(frozen=True)
class Freemap:
    """Free space of one level.

    Attributes:
        grid: the cells.
        floor_z_m: (rows, columns) float32 floor height [m]; NaN where there is no floor.
        traversable: (rows, columns) bool: floor, and nothing a robot of up to 2 m height could
            hit above the cell.
    """

    grid: GridSpec
    floor_z_m: NDArray[np.float32]
    traversable: NDArray[np.bool_]

    @cached_property
    def clearance_m(self) -> NDArray[np.float64]:
        """(rows, columns) [m] distance of each cell's centre to the nearest untraversable cell.

        The outside of the grid counts as untraversable. Measured to the blocked cell's edge.
        """
        padded = np.pad(self.traversable, 1)
        distance = distance_transform_edt(padded)[1:-1, 1:-1]
        return np.maximum(distance - 0.5, 0.0) * self.grid.cell_m

    def free(self, radius_m: float) -> NDArray[np.bool_]:
        """(rows, columns) bool: a disc of `radius_m` centred in the cell touches nothing."""
        return self.traversable & (self.clearance_m >= radius_m)

    def distance_field(self, goal_xy_m: ArrayLike, radius_m: float = 0.0) -> DistanceField:
        """Geodesic distances to `goal_xy_m` (2,) [m] for a disc of `radius_m`."""
        return DistanceField.build(self, np.asarray(goal_xy_m, dtype=np.float64), radius_m)


@dataclass(frozen=True)
class DistanceField:
    """Geodesic distance to one goal over a freemap (8-connected, exact per grid step).

    Attributes:
        grid: the cells.
        distance_m: (rows, columns) float64 [m]; inf where the goal cannot be reached.
        goal_xy_m: (2,) [m].
    """

    grid: GridSpec
    distance_m: NDArray[np.float64]
    goal_xy_m: NDArray[np.float64]

    @staticmethod
    def build(freemap: Freemap, goal_xy_m: NDArray[np.float64], radius_m: float) -> DistanceField:
        """Run Dijkstra from the goal over the cells free for `radius_m`."""
        grid = freemap.grid
        goal = grid.cell_of(goal_xy_m)
        distance = np.full(grid.shape, np.inf)
        if grid.inside(goal):
            costs = np.where(freemap.free(radius_m), 1.0, -1.0)
            # The goal's own cell is always a source, else a goal near a wall is unreachable.
            costs[tuple(goal)] = 1.0
            cumulative, _ = MCP_Geometric(costs).find_costs([tuple(goal)])
            distance = np.asarray(cumulative) * grid.cell_m
        return DistanceField(grid, distance, goal_xy_m)

    def at(self, xy_m: ArrayLike) -> NDArray[np.float64]:
        """Distance [m] from points (..., 2) [m]: (...), inf when unreachable.

        The nearest reachable cell within 0.5 m stands in for a point in a blocked cell, plus the
        straight distance to it. Within 1.5 cells of the goal the straight distance is exact.
        """
        xy = np.atleast_2d(np.asarray(xy_m, dtype=np.float64))
        cells = self.grid.cell_of(xy)
        result = np.full(len(xy), np.inf)
        reach = int(np.ceil(0.5 / self.grid.cell_m))
        for i, (point, (row, column)) in enumerate(zip(xy, cells, strict=True)):
            straight = float(np.linalg.norm(point - self.goal_xy_m))
            if straight <= 1.5 * self.grid.cell_m:
                result[i] = straight
                continue
            if self.grid.inside((row, column)) and np.isfinite(self.distance_m[row, column]):
                result[i] = self.distance_m[row, column]
                continue
            r0, c0 = max(row - reach, 0), max(column - reach, 0)
            window = self.distance_m[r0 : row + reach + 1, c0 : column + reach + 1]
            near = np.argwhere(np.isfinite(window))
            if len(near):
                centers = self.grid.center_of(near + (r0, c0))
                gaps = np.linalg.norm(centers - point, axis=1)
                best = int(np.argmin(gaps))
                if gaps[best] <= 0.5:
                    result[i] = window[tuple(near[best])] + gaps[best]
        return result.reshape(np.shape(xy_m)[:-1])
