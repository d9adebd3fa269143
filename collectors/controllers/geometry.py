"""Small plane geometry on plain floats: a control step has no time for arrays."""

from __future__ import annotations

import math


def wrap_angle(angle_rad: float) -> float:
    """The same direction in [−π, π)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def clip(value: float, low: float, high: float) -> float:
    """`value` within [low, high]."""
    return min(max(value, low), high)


class RouteCursor:
    """Progress along a polyline: the nearest point, looked for near the last one only.

    A route may pass the same place twice; looking near the last point keeps to the right pass.
    """

    def __init__(self, xy: list[tuple[float, float]], step_m: float, ahead_m: float = 0.8):
        self.xy = xy
        self.index = 0
        self._ahead = max(1, round(ahead_m / step_m))
        self._back = max(1, round(0.5 / step_m))

    def advance(self, x_m: float, y_m: float) -> float:
        """Move to the point nearest to (x, y); returns the distance to it [m]."""
        low = max(self.index - self._back, 0)
        high = min(self.index + self._ahead, len(self.xy) - 1)
        best, best_squared = self.index, math.inf
        for i in range(low, high + 1):
            px, py = self.xy[i]
            squared = (px - x_m) ** 2 + (py - y_m) ** 2
            if squared < best_squared:
                best, best_squared = i, squared
        self.index = best
        return math.sqrt(best_squared)
