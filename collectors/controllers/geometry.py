"""Plane geometry on scalars, for control steps that cannot afford array overhead."""

import math

import numpy as np

from ...formats.core.arrays import Array
from ...formats.process.kernel import kernel
from ...formats.scene.grid import GridSpec
from ..robots import CommandLimits
from .interface import Command


def wrap_angle(angle_rad: float) -> float:
    """Return an angle wrapped to [−π, π): `formats.core.frames.wrap_angle` for one number."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def clip(value: float, low: float, high: float) -> float:
    """Return `value` clipped to [low, high]."""
    return min(max(value, low), high)


def clip_command(command: Command, limits: CommandLimits) -> Command:
    """Return a command clipped to a robot's limits."""
    vx, vy, yaw = command
    return clip(vx, *limits.vx_m_s), clip(vy, *limits.vy_m_s), clip(yaw, *limits.yaw_rad_s)


def ramped(old: Command, new: Command, linear: float, turn: float) -> Command:
    """Return `new`, at most `linear` [m/s] and `turn` [rad/s] away from `old` on each axis."""
    (vx, vy, yaw), (x, y, z) = old, new
    return (
        vx + clip(x - vx, -linear, linear),
        vy + clip(y - vy, -linear, linear),
        yaw + clip(z - yaw, -turn, turn),
    )


class RouteCursor:
    """Progress along a polyline: the nearest point, searched near the previous one only.

    A route may pass the same place twice; the local search keeps to the current pass.
    """

    def __init__(self, xy_m: Array, step_m: float, ahead_m: float = 0.8):
        self.xy_m = np.ascontiguousarray(xy_m, dtype=np.float64)
        self.index = 0
        self.last = len(xy_m) - 1
        self._ahead = max(1, round(ahead_m / step_m))
        self._back = max(1, round(0.5 / step_m))

    def advance(self, x_m: float, y_m: float) -> float:
        """Move to the point nearest to (x, y) and return the distance to it [m]."""
        low = max(self.index - self._back, 0)
        high = min(self.index + self._ahead, self.last)
        self.index, distance = _nearest(self.xy_m, low, high, x_m, y_m)
        return distance

    def point(self, index: int) -> tuple[float, float]:
        """Return a point of the polyline [m]."""
        x, y = self.xy_m[index].tolist()
        return x, y

    def ahead(self, distance_m: float, step_m: float) -> int:
        """Return the index of the point `distance_m` ahead, at most the last."""
        return min(self.index + max(1, round(distance_m / step_m)), self.last)

    def in_sight(
        self,
        eye_xy_m: tuple[float, float],
        *,
        farthest: int,
        nearest: int,
        clearance_m: Array,
        needed_m: float,
        grid: GridSpec,
    ) -> int:
        """Return the farthest point that is seen through cells of enough clearance.

        Args:
            eye_xy_m: the viewpoint.
            farthest: index to begin with.
            nearest: index returned when no farther point is in sight.
            clearance_m: (rows, columns) of the map.
            needed_m: clearance that every cell on the way must have.
        """
        (x, y), (x0, y0), cell = eye_xy_m, grid.origin_xy_m, grid.cell_m
        # Everything in cells, so that the kernel needs no grid.
        points = (self.xy_m[nearest : farthest + 1] - (x0, y0)) / cell
        eye = ((x - x0) / cell, (y - y0) / cell)
        return nearest + _farthest_in_sight(points, eye, clearance_m, needed_m)


@kernel()
def _nearest(xy, low, high, x, y):
    best, best_squared = low, np.inf
    for i in range(low, high + 1):
        squared = (xy[i, 0] - x) ** 2 + (xy[i, 1] - y) ** 2
        if squared < best_squared:
            best, best_squared = i, squared
    return best, np.sqrt(best_squared)


@kernel()
def _farthest_in_sight(points, eye, clearance, needed):
    """Return the last of the points (N, 2) [cells] that is in sight of `eye`, or 0."""
    rows, columns = clearance.shape
    for index in range(len(points) - 1, 0, -1):
        dx, dy = points[index, 0] - eye[0], points[index, 1] - eye[1]
        count = int(np.hypot(dx, dy)) + 1
        seen = True
        for k in range(1, count + 1):
            column = int(np.floor(eye[0] + dx * k / count))
            row = int(np.floor(eye[1] + dy * k / count))
            inside = 0 <= row < rows and 0 <= column < columns
            if not inside or clearance[row, column] < needed:
                seen = False
                break
        if seen:
            return index
    return 0
