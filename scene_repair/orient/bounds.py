"""Bounds of a scan without stray triangles far away from it."""

import numpy as np

from ...formats.core.arrays import I64, Array
from ...formats.core.geometry import triangle_areas

# This share of the surface may lie beyond the bounds on either side of an axis, if it lies further
# away than this share of the extent.
STRAY_SHARE, STRAY_DISTANCE = 5e-4, 0.1


def robust_bounds(vertices: Array, faces: I64) -> tuple[Array, Array]:
    """Return lower and upper corner (3,) of a mesh (V, 3), (F, 3) with at least one face."""
    corners = vertices[faces]
    weight = triangle_areas(corners)
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    centers = corners.mean(axis=1)
    for axis in range(3):
        order = np.argsort(centers[:, axis])
        passed = np.cumsum(weight[order])
        marks = np.array([STRAY_SHARE, 1.0 - STRAY_SHARE]) * passed[-1]
        first, last = centers[order[np.searchsorted(passed, marks)], axis]
        slack = STRAY_DISTANCE * (last - first)
        inside = (centers[:, axis] >= first - slack) & (centers[:, axis] <= last + slack)
        if not inside.all():
            values = corners[inside, :, axis]
            lower[axis] = max(lower[axis], values.min())
            upper[axis] = min(upper[axis], values.max())
    return lower, upper
