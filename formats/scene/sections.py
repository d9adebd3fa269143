"""Horizontal sections of solids, so that renderings can cap the cut."""

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import I32, Array, Floats, Mask
from ..core.geometry import triangle_cross
from .grid import GridSpec


def inside_solids(
    vertices_m: Floats, faces: NDArray[np.integer], z_m: float, grid: GridSpec
) -> Mask:
    """Return (rows, columns) cells whose centres lie in the material of solids at a height.

    The section's outline is followed by winding number, counted from all four sides: a closed solid
    whose faces look outwards gives the same from each, an open or inverted surface does not.

    Args:
        vertices_m: (V, 3) world [m].
        faces: (F, 3), counter-clockwise seen from outside.
    """
    z = vertices_m[:, 2][faces]
    # A plane through vertices would meet edges twice.
    z_m += 1e-5
    cut = np.flatnonzero((z.min(axis=1) < z_m) & (z.max(axis=1) > z_m))
    outline = _outline(np.asarray(vertices_m, dtype=np.float64)[faces[cut]], z_m)
    outline = (outline - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
    along_rows = np.zeros((2, *grid.shape), dtype=np.int32)
    along_columns = np.zeros((2, grid.columns, grid.rows), dtype=np.int32)
    _count(outline, along_rows, 1)
    _count(np.ascontiguousarray(outline[..., ::-1]), along_columns, -1)
    solid = np.all(along_rows > 0, axis=0)
    return solid & np.all(along_columns > 0, axis=0).T


def _outline(triangles: Array, z_m: float) -> Array:
    """Return directed segments (N, 2, 2) of the section, the material on their left."""
    ends = np.full((len(triangles), 2, 2), np.nan)
    count = np.zeros(len(triangles), dtype=np.int64)
    for k in range(3):
        p, q = triangles[:, k], triangles[:, (k + 1) % 3]
        crosses = (p[:, 2] <= z_m) != (q[:, 2] <= z_m)
        share = np.zeros(len(triangles))
        share[crosses] = ((z_m - p[:, 2]) / np.where(crosses, q[:, 2] - p[:, 2], 1.0))[crosses]
        at = p[:, :2] + share[:, None] * (q[:, :2] - p[:, :2])
        rows = np.flatnonzero(crosses)
        ends[rows, count[rows]] = at[rows]
        count[rows] += 1
    normal = triangle_cross(triangles)
    ahead = ends[:, 1] - ends[:, 0]
    # The outward normal lies to the right of the segment.
    turned = ahead[:, 0] * normal[:, 1] - ahead[:, 1] * normal[:, 0] > 0
    ends[turned] = ends[turned][:, ::-1]
    return ends[count == 2]


def _count(segments: Array, winding: I32, sign: int) -> None:
    """Count winding numbers of the centres by the crossings on their left [0] and right [1]."""
    rows, columns = winding.shape[1:]
    (x0, y0), (x1, y1) = segments[:, 0].T, segments[:, 1].T
    first = np.maximum(np.ceil(np.minimum(y0, y1)).astype(np.int64), 0)
    end = np.minimum(np.ceil(np.maximum(y0, y1)).astype(np.int64), rows)
    count = np.maximum(end - first, 0)
    n = np.repeat(np.arange(len(segments)), count)
    row = np.arange(len(n)) + (first - np.cumsum(count) + count)[n]
    x = x0[n] + (row - y0[n]) / (y1[n] - y0[n]) * (x1[n] - x0[n])
    column = np.clip(np.ceil(x).astype(np.int64), 0, columns)
    turn = np.where(y1 > y0, sign, -sign)[n]
    right, left = column < columns, column > 0
    np.subtract.at(winding[0], (row[right], column[right]), turn[right])
    np.add.at(winding[1], (row[left], column[left] - 1), turn[left])
    np.cumsum(winding[0], axis=1, out=winding[0])
    np.cumsum(winding[1, :, ::-1], axis=1, out=winding[1, :, ::-1])
