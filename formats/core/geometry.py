"""Normals and areas of triangles, equal points, lengths along polylines, places far away."""

import math
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import I64, Array


def triangle_cross[S: np.floating[Any]](corners: NDArray[S]) -> NDArray[S]:
    """Return the cross products (F, 3) of two edges of triangles (F, 3, 3), in their dtype.

    They point along the normals, towards where the corners are counter-clockwise, and are twice as
    long as the areas.
    """
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return cast("NDArray[S]", cross)


def triangle_normals_and_areas[S: np.floating[Any]](
    corners: NDArray[S],
) -> tuple[NDArray[S], NDArray[S]]:
    """Return unit normals (F, 3), zero without an area, and areas (F,) of triangles (F, 3, 3)."""
    cross = triangle_cross(corners)
    doubled = _doubled_areas(cross)
    length = doubled[:, None]
    return np.divide(cross, length, out=np.zeros_like(cross), where=length > 0), 0.5 * doubled


def triangle_normals[S: np.floating[Any]](corners: NDArray[S]) -> NDArray[S]:
    """Return unit normals (F, 3) of triangles (F, 3, 3); zero for triangles without area."""
    return triangle_normals_and_areas(corners)[0]


def triangle_areas[S: np.floating[Any]](corners: NDArray[S]) -> NDArray[S]:
    """Return areas (F,) of triangles (F, 3, 3)."""
    return 0.5 * _doubled_areas(triangle_cross(corners))


def _doubled_areas(cross: NDArray[Any]) -> Any:
    """Return the lengths (F,) of crosses (F, 3) in their dtype; zero where squares underflow."""
    length = np.linalg.norm(cross, axis=1)
    length[length < np.sqrt(np.finfo(length.dtype).tiny)] = 0.0
    return length


def distinct_rows(rows: NDArray[Any]) -> tuple[I64, I64]:
    """Return the first of each kind of equal rows, in lexicographic order, and the kind of each.

    The same as `np.unique` of rows (N, D) along their axis, which takes several times as long.
    """
    order = np.lexsort(rows.T[::-1])
    ranked, new = rows[order], np.ones(len(rows), dtype=bool)
    new[1:] = (ranked[1:] != ranked[:-1]).any(axis=1)
    kind = np.empty(len(rows), dtype=np.int64)
    kind[order] = np.cumsum(new) - 1
    return order[new], kind


def arc_length(path_m: ArrayLike) -> Array:
    """Return the distances (P,) [m] of the points of a path (P, D) [m] from its start, along it."""
    path = np.asarray(path_m, dtype=np.float64)
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def path_length(path_m: ArrayLike) -> float:
    """Return the length [m] of a path (P, D) [m]."""
    return float(np.linalg.norm(np.diff(np.asarray(path_m), axis=0), axis=1).sum())


def point_along(path_m: ArrayLike, along_m: ArrayLike) -> Array:
    """Return points (..., D) at distances (...) [m] along a path (P, D) [m]; clamped to ends."""
    path = np.asarray(path_m, dtype=np.float64)
    return _between(path, arc_length(path), along_m)


def point_along_plan(path_m: ArrayLike, along_m: ArrayLike) -> Array:
    """Return the same for distances along a path (P, 3) [m] as it is seen from above."""
    path = np.asarray(path_m, dtype=np.float64)
    return _between(path, arc_length(path[:, :2]), along_m)


def onward(path_xy_m: Array, reach_m: float) -> Array:
    """Return points (K, 2) [m], 0.1 m apart, on the straight line from the end of a path (P, 2)."""
    step = path_xy_m[-1] - point_along(path_xy_m, max(0.0, path_length(path_xy_m) - 0.4))
    step = step / max(float(np.linalg.norm(step)), 1e-9)
    return path_xy_m[-1] + step * np.arange(0.1, reach_m + 1e-6, 0.1)[:, None]


def _between(path: Array, at_m: Array, along_m: ArrayLike) -> Array:
    along = np.asarray(along_m, dtype=np.float64)
    return np.stack([np.interp(along, at_m, column) for column in path.T], axis=-1)


def distances_to_path(points_m: ArrayLike, path_m: ArrayLike) -> Array:
    """Return the distances (N,) [m] of points (N, D) [m] to the line through a path (P, D) [m]."""
    path = np.asarray(path_m, dtype=np.float64)
    starts, along = path[:-1], np.diff(path, axis=0)
    to = np.asarray(points_m, dtype=np.float64)[:, None] - starts
    share = (to * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
    off = to - np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(off, axis=2).min(axis=1)


def resample(path_m: ArrayLike, spacing_m: float) -> Array:
    """Divide each segment of a path (P, D) [m] evenly so that none is longer than `spacing_m`.

    All given points are kept, so the shape is unchanged; repeated points are dropped.
    """
    path = np.asarray(path_m, dtype=np.float64)
    pieces = [path[:1]]
    for a, b in pairwise(path):
        length = float(np.linalg.norm(b - a))
        if length > 0:
            count = int(np.ceil(length / spacing_m - 1e-9))
            pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    result = np.concatenate(pieces)
    if len(result) == 1:
        return np.repeat(result, 2, axis=0)
    result[-1] = path[-1]
    return result


def space_evenly(path_m: ArrayLike, step_m: float) -> Array:
    """Return points (M, D), M ≥ 1, equally spaced along a path (P, D) [m].

    Keeps the ends but, unlike `resample`, cuts corners. The spacing is the largest one not above
    `step_m` that divides the length evenly.
    """
    path = np.asarray(path_m, dtype=np.float64)
    length = arc_length(path)[-1]
    if length == 0.0:
        return path[:1]
    count = max(math.ceil(length / step_m - 1e-9), 1)
    return point_along(path, np.linspace(0.0, length, count + 1))


# Coordinates this many times further out than a scan is large leave 32-bit numbers too few digits.
FAR_EXTENTS = 100.0
# Steps between 32-bit numbers, as a share of the extent, that would be seen.
COARSE_SHARE = 1e-4


def far_offset(points: NDArray[Any]) -> Array:
    """Return the round offset (3,) to subtract from points (N, 3) that lie far from the origin.

    It is 0 along axes on which the middle of the points lies near. Few points that are invalid or
    lie elsewhere do not matter.
    """
    points = np.asarray(points, dtype=np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return np.zeros(3)
    low, middle, high = np.quantile(points, (0.05, 0.5, 0.95), axis=0)
    extent = float((high - low).max())
    if not 0 < extent < np.inf:
        return np.zeros(3)
    step = 10.0 ** np.ceil(np.log10(extent))
    return np.where(np.abs(middle) > FAR_EXTENTS * extent, np.rint(middle / step) * step, 0.0)


def coarse_warning(points: NDArray[Any], offset: Array) -> list[str]:
    """Return a warning if points (N, 3) at `offset` (3,) were rounded to 32-bit numbers there."""
    sample = np.asarray(points[:: max(1, len(points) // 1000)], dtype=np.float64)
    extent = float(np.ptp(sample - offset, axis=0).max()) if len(sample) else 0.0
    step = float(np.spacing(np.float32(np.abs(offset).max())))
    if step <= COARSE_SHARE * extent or not np.array_equal(sample, sample.astype(np.float32)):
        return []
    gap = f"its coordinates are 32-bit numbers, which lie {step:.3g} units apart so far from the"
    return [f"{gap} origin: shapes are as coarse; export it nearer to the origin or in 64 bits"]
