"""Finding rectangles near a place without asking all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# About as large as what is asked for.
TILE_M = 1.0


class Tiles:
    """Rectangles along the axes (the bounds of faces from above), filed by the tiles they touch.

    Args:
        lower_m: (N, 2) corners.
        upper_m: (N, 2) corners, not below `lower_m`.
    """

    def __init__(self, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]):
        self.lower_m, self.upper_m = lower_m, upper_m
        self.origin = lower_m.min(axis=0) if len(lower_m) else np.zeros(2)
        first, last = self._tile(lower_m), self._tile(upper_m)
        self.shape = last.max(axis=0) + 1 if len(last) else np.zeros(2, dtype=np.int64)
        wide = last - first + 1
        count = wide.prod(axis=1)
        item = np.repeat(np.arange(len(lower_m)), count)
        step = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
        x = first[item, 0] + step % wide[item, 0]
        y = first[item, 1] + step // wide[item, 0]
        tile = y * self.shape[0] + x
        order = np.argsort(tile, kind="stable")
        self.item = item[order]
        self.start = np.searchsorted(tile[order], np.arange(int(self.shape.prod()) + 1))

    def near(self, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Sorted numbers (n,) of the rectangles that touch the one from `lower_m` to `upper_m`."""
        x0, y0 = np.maximum(self._tile(lower_m), 0)
        x1, y1 = np.minimum(self._tile(upper_m), self.shape - 1)
        if x1 < x0 or y1 < y0:
            return np.empty(0, dtype=np.int64)
        rows = [y * self.shape[0] for y in range(y0, y1 + 1)]
        found = np.concatenate(
            [self.item[self.start[r + x0] : self.start[r + x1 + 1]] for r in rows]
        )
        found = np.unique(found)
        touches = (self.upper_m[found] >= lower_m) & (self.lower_m[found] <= upper_m)
        return found[touches.all(axis=1)]

    def _tile(self, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.floor((xy_m - self.origin) / TILE_M).astype(np.int64)
