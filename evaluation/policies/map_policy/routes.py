"""Cheapest ways over the map seen so far, and the next step along one."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.graph import MCP_Geometric

from ....formats.core.frames import Array, wrap_angle
from ....formats.core.geometry import arc_length
from ....formats.core.rollout import Action
from .seen_map import CELL_M, SeenMap

_UNKNOWN = 4.0  # cost of a metre that has not been seen
_TIGHT = 6.0  # … of one that grazes an obstacle
_COMFORT_M = 0.4
_SQUEEZE = 40.0  # … of one closer to an obstacle than the robot's radius: out of a tight spot
_AHEAD_M = 0.6
_TURN_RAD = math.radians(15.0)


@dataclass(frozen=True)
class Routes:
    """The cheapest ways from where the robot stands.

    Attributes:
        cost: (R, C) cost of the way to each cell [m of free floor]; inf where there is none.
    """

    finder: MCP_Geometric
    cost: Array
    window: tuple[slice, slice]
    seen: SeenMap

    @classmethod
    def spread(cls, seen: SeenMap, xy_m: Array, radius_m: float) -> "Routes":
        """Find the ways from a point (2,) [m] for a disc of `radius_m`.

        Dijkstra's search, which is A* to all cells at once. Cells closer to an obstacle than the
        radius are nearly blocked, unseen ones expensive.
        """
        window = seen.window(margin_m=1.5)
        obstacle, explored = seen.obstacle[window], seen.explored[window]
        gap = np.asarray(distance_transform_edt(~obstacle)) * CELL_M
        price = 1.0 + _TIGHT * np.clip(1.0 - (gap - radius_m) / _COMFORT_M, 0.0, 1.0) ** 2
        price = np.where(gap < radius_m, _SQUEEZE, price)
        price = np.where(explored, price, price + _UNKNOWN)
        start = seen.grid.cell_of(xy_m) - (window[0].start, window[1].start)
        start = np.clip(start, 0, np.array(price.shape) - 1)
        blocked = obstacle.copy()
        blocked[tuple(start)] = False
        finder = MCP_Geometric(np.where(blocked, -1.0, price))
        cost, _ = finder.find_costs([tuple(start)])
        return cls(finder, np.asarray(cost) * CELL_M, window, seen)

    def reachable(self) -> NDArray[np.bool_]:
        """Return the cells (R, C) that a way reaches without squeezing past an obstacle."""
        result = np.zeros(self.seen.grid.shape, bool)
        result[self.window] = self.cost < 60.0
        return result

    def cost_to(self, xy_m: Array) -> float:
        """Return the cost of the way to a point (2,) [m]."""
        cell = self._cell(xy_m)
        return float(self.cost[cell]) if np.isfinite(self.cost[cell]) else math.inf

    def path_to(self, xy_m: Array) -> Array:
        """Return the way (P, 2) [m] to the reachable cell nearest to a point (2,) [m]."""
        cell = self._cell(xy_m)
        if not np.isfinite(self.cost[cell]):
            cells = np.argwhere(np.isfinite(self.cost))
            near = cells[np.argmin(np.linalg.norm(cells - np.array(cell), axis=1))]
            cell = (int(near[0]), int(near[1]))
        low = np.array((self.window[0].start, self.window[1].start))
        cells = np.array(self.finder.traceback(cell)) + low
        return self.seen.grid.center_of(cells)

    def _cell(self, xy_m: Array) -> tuple[int, int]:
        low = (self.window[0].start, self.window[1].start)
        cell = np.clip(self.seen.grid.cell_of(xy_m) - low, 0, np.array(self.cost.shape) - 1)
        return int(cell[0]), int(cell[1])


def next_action(path_m: Array, pose: Array) -> Action:
    """Return the discrete action along a way (P, 2) [m] from a pose x, y [m], yaw [rad]."""
    target = point_ahead(path_m, pose[:2], _AHEAD_M)
    error = bearing(pose, target)
    if abs(error) > 0.6 * _TURN_RAD:
        return Action.LEFT if error > 0 else Action.RIGHT
    return Action.FORWARD


def waypoints(path_m: Array, pose: Array, count: int = 4, spacing_m: float = 0.3) -> Array:
    """Return waypoints (K, 3) along a way: Δx, Δy [m], Δyaw [rad], see `checked_motion`."""
    steps, here = [], pose.astype(np.float64)
    for k in range(1, count + 1):
        target = point_ahead(path_m, pose[:2], k * spacing_m)
        if np.linalg.norm(target - here[:2]) < 0.05:
            break
        turn = bearing(here, target)
        distance = float(np.linalg.norm(target - here[:2]))
        steps.append((distance * math.cos(turn), distance * math.sin(turn), turn))
        here = np.array([*target, wrap_angle(here[2] + turn)])
    return np.array(steps) if steps else np.array([[0.0, 0.0, bearing(pose, path_m[-1])]])


def point_ahead(path_m: Array, xy_m: Array, ahead_m: float) -> Array:
    """Return the point of a way (P, 2) [m] that lies `ahead_m` beyond the one nearest to a point.

    It never lies beyond the end of the way.
    """
    nearest = int(np.argmin(np.linalg.norm(path_m - xy_m, axis=1)))
    rest = path_m[nearest:]
    return rest[min(int(np.searchsorted(arc_length(rest), ahead_m)), len(rest) - 1)]


def bearing(pose: Array, xy_m: Array) -> float:
    """Return the direction [rad] of a point (2,) [m] from a pose, left is positive."""
    dx, dy = xy_m - pose[:2]
    return float(wrap_angle(math.atan2(dy, dx) - pose[2]))


def blocked(seen: SeenMap, path_m: Array) -> bool:
    """Return whether an obstacle has been seen on a way since it was planned."""
    cells = seen.grid.cell_of(path_m)
    return bool(seen.obstacle[cells[:, 0], cells[:, 1]].any())
