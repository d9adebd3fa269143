"""The shortest ways from a pose to every place of a level, as one tree of grid cells."""

import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from ....formats.core.frames import Array
from .world import CELL_M, World

EVENT_RAD = np.deg2rad(45.0)  # a clear turn
_BACK = 16  # ancestors that are kept
_NEW, _GAP, _OLD = 4, 7, 11  # cells: a heading over the last 4, and one from 11 to 7 before
_LONG_GAP, _LONG_OLD = 12, 16
_APART = 6  # cells between two turns to one side
_EXITS = 5  # ways out of a room that are looked at, at most
PENALTY = 1.0  # of a right angle that is walked but not mentioned

Ids = NDArray[np.int64]


class Ways:
    """Ways to N cells; the way to a cell goes through its ancestors.

    Attributes:
        cells: (N, 2) rows and columns.
        points_m: (N, 2) [m].
        before: (17, N) ancestors: `before[k]` is k cells back, the start where there are fewer.
        along_m: (N,) length of the way [m].
        heading_rad: (N,) of the walk on arriving.
        turn_rad: (N,) change of heading over the last two metres, left is positive.
        long_turn_rad: (N,) over the last three.
        aside_rad: (N,) direction to the cell from a metre and a half before, left is positive.
        event: (N,) whether a clear turn has just been made.
        unmentioned: (N,) cost of the way's clear turns, if the text mentions none of them.
        region: (N,) region of the level.
    """

    def __init__(self, world: World, price: Array, start_m: Array, start_yaw_rad: float):
        """Spread from a pose: (2,) [m] and heading [rad], at a price (R, C) per cell."""
        finder = MCP_Geometric(price)
        start = world.cell(np.asarray(start_m, dtype=np.float64)[:2])
        cost, trace = finder.find_costs([start])
        self.cells = np.argwhere(np.isfinite(cost) & world.free)
        self.cells = self.cells[np.argsort(cost[tuple(self.cells.T)], kind="stable")]
        ids = np.full(world.free.shape, -1, dtype=np.int64)
        ids[tuple(self.cells.T)] = np.arange(len(self.cells))
        step = np.asarray(finder.offsets)[trace[tuple(self.cells.T)]]
        step[0] = 0
        parent = ids[tuple((self.cells - step).T)]
        self.points_m = world.centers_m[tuple(self.cells.T)]
        self.region = world.region[tuple(self.cells.T)]
        self._levels = _levels(parent)
        self._parent = parent
        length = np.linalg.norm(self.points_m - self.points_m[parent], axis=1)
        self.along_m = self._summed(length)
        depth = self._summed((np.arange(len(parent)) > 0).astype(np.float64))
        chain: list[NDArray[np.int64]] = [np.arange(len(parent))]
        for _ in range(_BACK):
            chain.append(parent[chain[-1]])
        self.before = np.stack(chain)
        self._directions(depth, start_yaw_rad)
        above = np.abs(self.turn_rad) >= EVENT_RAD
        recent = above[self.before[1 : _APART + 1]]
        recent &= np.sign(self.turn_rad)[self.before[1 : _APART + 1]] == np.sign(self.turn_rad)
        self.event = above & ~recent.any(axis=0)
        size = np.minimum(np.abs(self.turn_rad), np.deg2rad(120.0)) / np.deg2rad(90.0)
        self.unmentioned = self._summed(np.where(self.event, PENALTY * size, 0.0))

    def _directions(self, depth: Array, yaw: float) -> None:
        ahead = np.array([np.cos(yaw), np.sin(yaw)])

        def back(k: int) -> Array:
            """Place k cells back; before the start the walker came straight on."""
            lacking = np.maximum(k - depth, 0.0)[:, None]
            return self.points_m[self.before[k]] - lacking * CELL_M * ahead

        def heading(a: int, b: int) -> Array:
            delta = back(a) - back(b)
            return np.arctan2(delta[:, 1], delta[:, 0])

        self.heading_rad = heading(0, _NEW)
        self.turn_rad = wrap(self.heading_rad - heading(_GAP, _OLD))
        self.long_turn_rad = wrap(self.heading_rad - heading(_LONG_GAP, _LONG_OLD))
        self.aside_rad = wrap(heading(0, 10) - heading(10, 14))

    def _summed(self, value: Array) -> Array:
        """Return the sum of a value (N,) over a cell and its ancestors."""
        total = value.copy()
        for level in self._levels[1:]:
            total[level] += total[self._parent[level]]
        return total

    def onward(self, cost: Array) -> Array:
        """Return the least cost (N,) of a cell or any ancestor, with the turns walked since."""
        least = cost - self.unmentioned
        for level in self._levels[1:]:
            least[level] = np.minimum(least[level], least[self._parent[level]])
        return least + self.unmentioned

    def lately(self, cost: Array, cells: int) -> Array:
        """Return the least value (N,) at a cell or up to `cells` ≤ 16 before it."""
        return cost[self.before[: cells + 1]].min(axis=0)

    def bearing_rad(self, low_m: Array, high_m: Array) -> Array:
        """Return (N,) direction to the nearest edge of a box (2,), (2,) [m], left is positive."""
        to = np.clip(self.points_m, low_m, high_m) - self.points_m
        return wrap(np.arctan2(to[:, 1], to[:, 0]) - self.heading_rad)

    def cells_before(self, back_m: tuple[float, float]) -> range:
        """Return how many cells back a distance between two [m] is, at most."""
        return range(int(back_m[0] / (1.45 * CELL_M)), int(back_m[1] / CELL_M) + 2)

    def ancestors(self, count: int) -> list[Ids]:
        """Return the ancestors 0 … `count` cells back."""
        chain = list(self.before[: count + 1])
        while len(chain) <= count:
            chain.append(self._parent[chain[-1]])
        return chain


def ways_from(world: World, start_m: Array, start_yaw_rad: float) -> list[Ways]:
    """Return ways from a pose (2,) [m] and heading [rad]: the shortest, and by each way out.

    The second and further sets leave the room of the start into one of its neighbours only.
    """
    start = np.asarray(start_m, dtype=np.float64)[:2]
    room = int(world.region[world.cell(start)])
    result = [Ways(world, world.cost, start, start_yaw_rad)]
    beyond = {k: world.beside(room, k) for k in range(len(world.rooms)) if k != room}
    exits = [k for k, cells in beyond.items() if cells.any()]
    for exit_ in exits if 2 <= len(exits) <= _EXITS else ():
        shut = np.any([beyond[k] for k in exits if k != exit_], axis=0)
        result.append(Ways(world, np.where(shut, -1.0, world.cost), start, start_yaw_rad))
    return result


def _levels(parent: Ids) -> list[Ids]:
    """Return the cells by depth of the tree; cells come after their parents."""
    depth = np.zeros(len(parent), dtype=np.int64)
    for k in range(1, len(parent)):
        depth[k] = depth[parent[k]] + 1
    order = np.argsort(depth, kind="stable")
    return np.split(order, np.searchsorted(depth[order], np.arange(1, depth.max(initial=0) + 1)))


def wrap(angle_rad: Array) -> Array:
    """Wrap angles to −π … π."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi
