"""Geodesic distance to a goal over a level's planning map.

The sampler plans episodes with it; the collectors re-plan, and measure NE, OS and SPL with it.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from ..formats.core.arrays import I64, Array, Mask
from ..formats.scene.freemap import Freemap
from ..formats.scene.grid import GridSpec
from .geodesic import taut_distances

# Shortest ways are those of VLN-CE's own agent, Habitat's disc of this radius, for every robot: so
# NE, OS and SPL compare between robots and with published numbers, and a wide body's longer way
# round shows up as what embodiment costs.
AGENT_RADIUS_M = 0.10
SNAP_M = 0.5  # a point this close to reachable floor counts as standing there


@dataclass(frozen=True)
class DistanceField:
    """Geodesic distance to one goal over a freemap; see `geodesic`.

    Attributes:
        distance_m: (rows, columns) float64 [m] from each cell's centre to the goal; inf where the
            goal cannot be reached.
        goal_xy_m: (2,) [m].
    """

    grid: GridSpec
    distance_m: Array
    goal_xy_m: Array

    @cached_property
    def _nearest_reachable(self) -> I64:
        """Return the reachable cell (rows, columns, 2) nearest to each cell."""
        blocked = ~np.isfinite(self.distance_m)
        index = distance_transform_edt(blocked, return_distances=False, return_indices=True)
        return np.moveaxis(np.asarray(index, dtype=np.int64), 0, -1)

    def at(self, xy_m: ArrayLike, within_m: float = SNAP_M) -> Array:
        """Return distances (...) [m] from points (..., 2) [m]; inf where unreachable.

        A point's value is the least over the 3 × 3 cells about the reachable cell nearest to it
        of their distance plus the straight way to their centre. Points farther than `within_m`
        from every reachable cell are unreachable. Within 1.5 cells of the goal the straight
        distance is exact.
        """
        points = np.asarray(xy_m, dtype=np.float64)
        flat = points.reshape(-1, 2)
        straight = np.linalg.norm(flat - self.goal_xy_m, axis=1)
        result = np.full(len(flat), np.inf)
        if np.isfinite(self.distance_m).any():
            limit, cells = np.array(self.grid.shape) - 1, self.grid.clamped_cell_of(flat)
            base, blocked = cells.copy(), ~np.isfinite(self.distance_m[cells[:, 0], cells[:, 1]])
            if blocked.any():  # the search for reachable cells takes as long as all the rest
                base[blocked] = self._nearest_reachable[cells[blocked, 0], cells[blocked, 1]]
            home = np.linalg.norm(self.grid.center_of(base) - flat, axis=1) <= within_m
            for step in product((-1, 0, 1), repeat=2):
                near = np.clip(base + np.array(step), 0, limit)
                gap = np.linalg.norm(self.grid.center_of(near) - flat, axis=1)
                total = self.distance_m[near[:, 0], near[:, 1]] + gap
                result = np.where(home, np.minimum(result, total), result)
        near_goal = straight <= 1.5 * self.grid.cell_m
        # No way is shorter than the straight one; cells are measured from their centres.
        result = np.where(near_goal, straight, np.maximum(result, straight))
        return result.reshape(points.shape[:-1])


def distance_field(freemap: Freemap, goal_xy_m: ArrayLike, radius_m: float = 0.0) -> DistanceField:
    """Return the geodesic distances to `goal_xy_m` (2,) [m] over the cells free for `radius_m`.

    A goal in a blocked cell is entered from the free cells within `SNAP_M`, as a point in a
    blocked cell is left (see `DistanceField.at`).
    """
    grid = freemap.grid
    free = freemap.free(radius_m)
    distance = np.full(grid.shape, np.inf)
    goal = np.asarray(goal_xy_m, dtype=np.float64)
    source = nearest_cell(grid, free, goal, SNAP_M)
    if source is not None:
        offset = (goal - grid.center_of(source))[::-1] / grid.cell_m
        if np.abs(offset).max() <= 0.5 + 1e-9:
            distance = taut_distances(free, *source, *offset) * grid.cell_m
        else:
            gap = float(np.linalg.norm(offset))
            distance = (taut_distances(free, *source, 0.0, 0.0) + gap) * grid.cell_m
    return DistanceField(grid, distance, goal)


def nearest_cell(
    grid: GridSpec, mask: Mask, xy_m: ArrayLike, within_m: float
) -> tuple[int, int] | None:
    """Return the cell of `mask` (rows, columns) nearest to a point (2,) [m], None if too far.

    The cell that the point lies in, if it is in the mask, wins at any `within_m`.
    """
    xy = np.asarray(xy_m, dtype=np.float64)
    own = grid.cell_of(xy)
    if grid.inside(own) and mask[tuple(own)]:
        return int(own[0]), int(own[1])
    reach = int(np.ceil(within_m / grid.cell_m)) + 1
    low = np.maximum(own - reach, 0)
    window = mask[low[0] : max(own[0] + reach + 1, 0), low[1] : max(own[1] + reach + 1, 0)]
    cells = np.argwhere(window) + low
    gaps = np.linalg.norm(grid.center_of(cells) - xy, axis=1)
    if gaps.min(initial=np.inf) > within_m:
        return None
    row, column = cells[np.argmin(gaps)].tolist()
    return row, column
