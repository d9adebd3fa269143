"""Where things are from a path: distances, bearings and walls between, for all at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...formats.core.geometry import path_length, point_along
from ...wayfinding.regions import RegionMap

Array = NDArray[np.float64]

MOMENT_M = 0.25
REACH_M = 8.0
_AHEAD_M = 0.4
_LINE_SAMPLES = 48
WALL_SKIN_M, DEEP_SKIN_M = 0.10, 0.35  # windows and doorways lie this deep in a wall


@dataclass(frozen=True)
class Track:
    """A path, sampled.

    Attributes:
        along_m: (S,) [m].
        points_m: (S, 2) [m].
        heading_rad: (S,) of the walk.
    """

    along_m: Array
    points_m: Array
    heading_rad: Array

    def between(self, low_m: float, high_m: float) -> "Track":
        """Return the samples between two places of the path [m]."""
        inside = (self.along_m >= low_m) & (self.along_m <= high_m)
        return Track(self.along_m[inside], self.points_m[inside], self.heading_rad[inside])

    def bearing_deg(self, along_m: float, to_xy_m: Array) -> float:
        """Return the direction to a place (2,) [m] from a place of the path, left is positive."""
        k = self._sample_at(along_m)
        to = to_xy_m - self.points_m[k]
        bearing = np.rad2deg(np.arctan2(to[1], to[0]) - self.heading_rad[k])
        return round(float((bearing + 180) % 360 - 180), 1)

    def heading_at_rad(self, along_m: float) -> float:
        """Return the heading of the walk at a place of the path."""
        return float(self.heading_rad[self._sample_at(along_m)])

    def _sample_at(self, along_m: float) -> int:
        k = int(np.searchsorted(self.along_m, max(0.0, along_m)))
        return min(k, len(self.along_m) - 1)


@dataclass(frozen=True)
class Relations:
    """Where N boxes are from S points.

    Attributes:
        distance_m: (S, N) to the nearest edge [m].
        bearing_rad: (S, N) to the nearest edge, left is positive.
        facing_rad: (S, N) to the middle.
        open: (S, N) whether no wall stands between.
    """

    distance_m: Array
    bearing_rad: Array
    facing_rad: Array
    open: NDArray[np.bool_]


def track_of(path_xy_m: Array) -> Track:
    """Sample a path (P, 2) [m]."""
    length = path_length(path_xy_m)
    samples = max(2, round(length / MOMENT_M) + 1)
    along = np.asarray(np.linspace(0.0, length, samples), dtype=np.float64)
    ahead = point_along(path_xy_m, np.minimum(along + _AHEAD_M, length))
    behind = point_along(path_xy_m, np.maximum(along - _AHEAD_M, 0.0))
    delta = ahead - behind
    return Track(along, point_along(path_xy_m, along), np.arctan2(delta[:, 1], delta[:, 0]))


def relations(
    track: Track, low_m: Array, high_m: Array, regions: RegionMap, skin_m: Array
) -> Relations:
    """Relate boxes `low_m` … `high_m` (N, 2) [m] to a track; `skin_m` (N,): see no_wall_between."""
    points = track.points_m[:, None]
    edge = np.clip(points, low_m, high_m)
    to_edge = edge - points
    distance = np.linalg.norm(to_edge, axis=-1)
    to_middle = 0.5 * (low_m + high_m) - points
    to_edge = np.where(distance[..., None] < 0.05, to_middle, to_edge)
    heading = track.heading_rad[:, None]
    near = distance <= REACH_M
    clear = np.zeros(distance.shape, dtype=bool)
    s, n = np.nonzero(near)
    if len(s):
        clear[s, n] = no_wall_between(
            track.points_m[s], edge[s, n], distance[s, n], regions, skin_m[n]
        )
    return Relations(distance, _turned(to_edge, heading), _turned(to_middle, heading), clear)


def _turned(vector: Array, heading: Array) -> Array:
    angle = np.arctan2(vector[..., 1], vector[..., 0]) - heading
    return (angle + np.pi) % (2 * np.pi) - np.pi


def skin_of(noun: str) -> float:
    """Return how deep in a wall a thing of a kind may stand [m]."""
    return DEEP_SKIN_M if noun in ("window", "doorway", "opening") else WALL_SKIN_M


def no_wall_between(
    start: Array, end: Array, length: Array, regions: RegionMap, skin_m: Array | float = WALL_SKIN_M
) -> NDArray[np.bool_]:
    """Return whether lines (K, 2) → (K, 2) meet no wall before the last `skin_m` [m].

    The thing itself may stand at a wall, and a window or doorway is in one.
    """
    share = np.maximum(0.0, 1.0 - skin_m / np.maximum(length, skin_m))
    steps: Array = np.linspace(0.0, 1.0, _LINE_SAMPLES, dtype=np.float64)
    clear = np.ones(len(start), dtype=bool)
    # Few places show most walls: only lines that meet none there are looked at closely.
    for some in (steps[:: _LINE_SAMPLES // 6], steps):
        left = np.flatnonzero(clear)
        t = np.asarray(some * share[left, None], dtype=np.float64)
        clear[left] = _open_at(start[left], (end - start)[left], t, regions).all(axis=1)
    return clear


def _open_at(start: Array, way: Array, t: Array, regions: RegionMap) -> NDArray[np.bool_]:
    """Return (K, T) whether start (K, 2) + way (K, 2) · t (K, T) [m] are in no wall.

    Each axis on its own: pairs of coordinates cost several times as much.
    """
    grid = regions.grid
    column, row = (
        np.clip(
            np.floor(((start[:, k, None] + way[:, k, None] * t) - low_m) / grid.cell_m), 0, last
        ).astype(np.int64)
        for k, low_m, last in zip(
            (0, 1), grid.origin_xy_m, (grid.columns - 1, grid.rows - 1), strict=True
        )
    )
    return regions.width_m.ravel()[row * grid.columns + column] > 0
