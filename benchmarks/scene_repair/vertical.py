"""Vertical rays through triangles: the measuring instrument, apart from the code it measures."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vlnpe.formats.core.arrays import Array, Floats

BUCKET_M = 0.1


@dataclass(frozen=True)
class Surfaces:
    """Triangles between two heights.

    Attributes:
        corners_m: (F, 3, 3).
    """

    corners_m: Array

    @staticmethod
    def between(
        vertices_m: Floats,
        faces: NDArray[np.integer],
        low_m: float = -np.inf,
        high_m: float = np.inf,
    ) -> "Surfaces":
        """Return those of a mesh (V, 3), (F, 3) that reach into the band of heights."""
        z = vertices_m[:, 2][faces]
        use = (z.max(axis=1) >= low_m) & (z.min(axis=1) <= high_m)
        return Surfaces(vertices_m[faces[use]].astype(np.float64))


def heights_near(
    surfaces: Surfaces,
    points_xy_m: Array,
    z_m: Array | float,
    within_m: float,
) -> Array:
    """Return the height of the surface nearest to `z_m` on the vertical line through each point.

    Args:
        surfaces: what the rays may meet.
        points_xy_m: (N, 2).
        z_m: (N,) or one height for all.
        within_m: surfaces farther from it than this do not count.

    Returns:
        (N,) heights, NaN where no surface is met.
    """
    z = np.broadcast_to(np.asarray(z_m, dtype=np.float64), len(points_xy_m))
    corners = surfaces.corners_m
    if not len(points_xy_m) or not len(corners):
        return np.full(len(points_xy_m), np.nan)
    low, high = corners.min(axis=1), corners.max(axis=1)
    lower, upper = points_xy_m.min(axis=0), points_xy_m.max(axis=0)
    use = (high[:, 2] >= z.min() - within_m) & (low[:, 2] <= z.max() + within_m)
    use &= np.all((high[:, :2] >= lower) & (low[:, :2] <= upper), axis=1)
    corners = corners[use]
    shape = np.floor((upper - lower) / BUCKET_M).astype(np.int64) + 1
    bucket = np.floor((points_xy_m - lower) / BUCKET_M).astype(np.int64)
    flat = bucket[:, 1] * shape[0] + bucket[:, 0]
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], np.arange(shape[0] * shape[1] + 1))
    z = np.ascontiguousarray(z)
    nearest = np.full(len(points_xy_m), np.nan)
    _shoot(corners, points_xy_m, z, within_m, (lower, shape, order, start), nearest)
    return nearest


@njit(cache=True)
def _shoot(corners, points, z, within, buckets, nearest):
    lower, shape, order, start = buckets
    for f in range(len(corners)):
        ax, ay, az = corners[f, 0]
        bx, by, bz = corners[f, 1]
        cx, cy, cz = corners[f, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        i0 = max(int(np.floor((min(ax, bx, cx) - lower[0]) / BUCKET_M)), 0)
        i1 = min(int(np.floor((max(ax, bx, cx) - lower[0]) / BUCKET_M)), shape[0] - 1)
        j0 = max(int(np.floor((min(ay, by, cy) - lower[1]) / BUCKET_M)), 0)
        j1 = min(int(np.floor((max(ay, by, cy) - lower[1]) / BUCKET_M)), shape[1] - 1)
        for j in range(j0, j1 + 1):
            for i in range(i0, i1 + 1):
                cell = j * shape[0] + i
                for k in range(start[cell], start[cell + 1]):
                    p = order[k]
                    x, y = points[p]
                    u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                    v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                    w = 1.0 - u - v
                    if u < -1e-9 or v < -1e-9 or w < -1e-9:
                        continue
                    height = u * az + v * bz + w * cz
                    gap = abs(height - z[p])
                    if gap <= within and not gap >= abs(nearest[p] - z[p]):
                        nearest[p] = height
