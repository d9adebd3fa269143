"""Small plane geometry on plain numbers: a control step has no time for whole arrays."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...formats.core.kernel import kernel
from ...formats.scene.grid import GridSpec


def wrap_angle(angle_rad: float) -> float:
    """The same direction in [−π, π): `formats.frames.wrap_angle` for one number, without numpy."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def clip(value: float, low: float, high: float) -> float:
    """`value` within [low, high]."""
    return min(max(value, low), high)


class RouteCursor:
    """Progress along a polyline: the nearest point, looked for near the last one only.

    A route may pass the same place twice; looking near the last point keeps to the right pass.
    """

    def __init__(self, xy_m: NDArray[np.float64], step_m: float, ahead_m: float = 0.8):
        self.xy_m = np.ascontiguousarray(xy_m, dtype=np.float64)
        self.index = 0
        self.last = len(xy_m) - 1
        self._ahead = max(1, round(ahead_m / step_m))
        self._back = max(1, round(0.5 / step_m))

    def advance(self, x_m: float, y_m: float) -> float:
        """Move to the point nearest to (x, y); returns the distance to it [m]."""
        low = max(self.index - self._back, 0)
        high = min(self.index + self._ahead, self.last)
        self.index, distance = _nearest(self.xy_m, low, high, x_m, y_m)
        return distance

    def point(self, index: int) -> tuple[float, float]:
        """One point of the polyline [m]."""
        x, y = self.xy_m[index].tolist()
        return x, y

    def ahead(self, distance_m: float, step_m: float) -> int:
        """Index of the point so far ahead, at most the last."""
        return min(self.index + max(1, round(distance_m / step_m)), self.last)

    def in_sight(
        self,
        x_m: float,
        y_m: float,
        farthest: int,
        nearest: int,
        clearance_m: NDArray[np.float64],
        needed_m: float,
        grid: GridSpec,
    ) -> int:
        """The farthest point ≤ `farthest` seen from (x, y) through cells of enough clearance.

        Args:
            x_m: from where [m].
            y_m: from where [m].
            farthest: index to begin with.
            nearest: index returned when no farther point is in sight.
            clearance_m: (rows, columns) of the map.
            needed_m: clearance that every cell on the way must have.
            grid: the map's.
        """
        return _farthest_in_sight(
            self.xy_m,
            x_m,
            y_m,
            farthest,
            nearest,
            clearance_m,
            needed_m,
            *grid.origin_xy_m,
            grid.cell_m,
        )


@kernel()
def _nearest(xy, low, high, x, y):
    best, best_squared = low, np.inf
    for i in range(low, high + 1):
        squared = (xy[i, 0] - x) ** 2 + (xy[i, 1] - y) ** 2
        if squared < best_squared:
            best, best_squared = i, squared
    return best, np.sqrt(best_squared)


@kernel()
def _farthest_in_sight(xy, x, y, farthest, nearest, clearance, needed, x0, y0, cell):
    rows, columns = clearance.shape
    for index in range(farthest, nearest, -1):
        dx, dy = xy[index, 0] - x, xy[index, 1] - y
        count = int(np.hypot(dx, dy) / cell) + 1
        seen = True
        for k in range(1, count + 1):
            column = int(np.floor((x + dx * k / count - x0) / cell))
            row = int(np.floor((y + dy * k / count - y0) / cell))
            inside = 0 <= row < rows and 0 <= column < columns
            if not inside or clearance[row, column] < needed:
                seen = False
                break
        if seen:
            return index
    return nearest
