"""Distances between paths, and a search for the paths near a given one."""

from collections import defaultdict
from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.frames import Array
from ..formats.core.geometry import path_length, point_along
from ..formats.process.kernel import kernel
from .config import DTW, FRECHET

STATION_M = 0.25


def stations(path_m: ArrayLike, dimensions: int = 2) -> Array:
    """Return a path (P, 2 or 3) [m] as points (S, D) at equal steps of at most `STATION_M`."""
    path = np.asarray(path_m, dtype=np.float64)[:, :dimensions]
    length = path_length(path)
    count = max(2, int(np.ceil(length / STATION_M)) + 1)
    return point_along(path, np.linspace(0.0, length, count))


def path_gap(path_m: ArrayLike, other_m: ArrayLike, measure: str = FRECHET) -> float:
    """Return the distance of two paths (P, 2 or 3) [m]; directed: the way back is another path.

    `frechet` is the discrete Fréchet distance (Eiter and Mannila, "Computing discrete Fréchet
    distance", 1994): walking both from start to end, the walkers need not be farther apart than
    this. `dtw` is the sum of distances under dynamic time warping, divided by the number of
    stations of the longer path.
    """
    return _gap(stations(path_m), stations(other_m), measure)


class PathIndex:
    """Paths by where they start and end, so that looking up takes as long with many as with few.

    The Fréchet distance of two paths is at least that of their starts and of their ends: only those
    that share both neighbourhoods are compared. DTW has no such bound; there the distance of one
    path's stations to the other's bounding box says which pairs cannot be near.
    """

    def __init__(self, reach_m: float, measure: str = FRECHET):
        """Prepare for look-ups of paths closer than `reach_m`."""
        self.reach_m, self.measure = reach_m, measure
        self.paths: list[Array] = []
        self._bins: dict[tuple[int, ...], list[int]] = defaultdict(list)
        self._boxes = np.zeros((0, 4))

    def add(self, path: Array) -> int:
        """Add a path's stations (S, D) [m]; return its number."""
        number = len(self.paths)
        self.paths.append(path)
        self._bins[self._bin(path[0], path[-1])].append(number)
        if self.measure == DTW:
            if number >= len(self._boxes):
                self._boxes = np.vstack([self._boxes, np.zeros((max(64, number), 4))])
            self._boxes[number] = *path[:, :2].min(axis=0), *path[:, :2].max(axis=0)
        return number

    def near(self, path: Array) -> dict[int, float]:
        """Return the distances [m], by number, of paths within `reach_m` of stations (S, D) [m]."""
        gaps = {}
        for number in self._candidates(path):
            gap = _gap(path, self.paths[number], self.measure)
            if gap < self.reach_m:
                gaps[number] = gap
        return gaps

    def starting_near(self, point: Array) -> list[int]:
        """Return the numbers of the paths that start within `reach_m` of a point (D,) [m]."""
        return [k for k, path in enumerate(self.paths) if _close(path[0], point, self.reach_m)]

    def ending_near(self, point: Array) -> list[int]:
        """Return the numbers of the paths that end within `reach_m` of a point (D,) [m]."""
        return [k for k, path in enumerate(self.paths) if _close(path[-1], point, self.reach_m)]

    def _candidates(self, path: Array) -> Iterator[int]:
        if self.measure == DTW:
            yield from self._by_boxes(path)
            return
        home = self._bin(path[0], path[-1])
        for offset in product((-1, 0, 1), repeat=4):
            for number in self._bins.get(tuple(np.add(home, offset).tolist()), ()):
                other = self.paths[number]
                if _close(path[0], other[0], self.reach_m) and _close(
                    path[-1], other[-1], self.reach_m
                ):
                    yield number

    def _by_boxes(self, path: Array) -> Iterator[int]:
        boxes = self._boxes[: len(self.paths)]
        low = np.maximum(boxes[:, None, :2] - path[:, :2], 0.0)
        high = np.maximum(path[:, :2] - boxes[:, None, 2:], 0.0)
        apart = np.linalg.norm(np.maximum(low, high), axis=2).sum(axis=1)
        longest = np.array([max(len(path), len(other)) for other in self.paths])
        yield from np.flatnonzero(apart < self.reach_m * longest).tolist()

    def _bin(self, start: Array, end: Array) -> tuple[int, ...]:
        ends = np.concatenate([start[:2], end[:2]])
        return tuple(np.floor(ends / self.reach_m).astype(int).tolist())


def _close(a: Array, b: Array, within_m: float) -> bool:
    return float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) < within_m**2


def _gap(a: Array, b: Array, measure: str) -> float:
    gap = float(_coupled(a, b, measure == DTW))
    return gap / max(len(a), len(b)) if measure == DTW else gap


@kernel()
def _coupled(a: Array, b: Array, summed: bool) -> float:
    """Return the least sum, or the least maximum, of distances over all monotone couplings."""
    row = np.full(len(b), np.inf)
    for i in range(len(a)):
        before = np.inf  # the value up and to the left
        for j in range(len(b)):
            apart = np.hypot(a[i, 0] - b[j, 0], a[i, 1] - b[j, 1])
            for k in range(2, a.shape[1]):
                apart = np.hypot(apart, a[i, k] - b[j, k])
            best = row[j]
            if j > 0:
                best = min(best, before, row[j - 1])
            if i == 0 and j == 0:
                best = 0.0
            before = row[j]
            row[j] = apart + best if summed else max(apart, best)
    return row[-1]
