"""Horizontal cuts through a level, which show upright surfaces."""

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import I64, Array
from ...formats.process.kernel import kernel
from ...formats.scene.grid import GridSpec
from .morphology import Window


def slice_marks(
    vertices_m: Array, faces: I64, grid: GridSpec, heights_m: Array, window: Window | None = None
) -> NDArray[np.uint32]:
    """Return cells whose bit n is set if a surface crosses the plane z = `heights_m[n]` (n < 32).

    Vertices are (V, 3) in the world, faces (F, 3). Only the `window` of the grid is looked at, if
    given.
    """
    rows, columns = window or (slice(0, grid.rows), slice(0, grid.columns))
    scaled = (vertices_m - (*grid.origin_xy_m, 0.0)) / (grid.cell_m, grid.cell_m, 1.0)
    marks = np.zeros((rows.stop - rows.start, columns.stop - columns.start), dtype=np.uint32)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    _mark(scaled, faces, heights_m.astype(float), (rows.start, columns.start), marks)
    return marks


@kernel()
def _mark(vertices, faces, heights, first, marks):
    rows, columns = marks.shape
    end = np.empty((2, 2))
    for f in range(len(faces)):
        z0 = vertices[faces[f, 0], 2]
        z1 = vertices[faces[f, 1], 2]
        z2 = vertices[faces[f, 2], 2]
        low, high = min(z0, z1, z2), max(z0, z1, z2)
        for n in range(len(heights)):
            h = heights[n]
            if h < low or h > high or low == high:
                continue
            ends = 0
            for k in range(3):
                p, q = faces[f, k], faces[f, (k + 1) % 3]
                zp, zq = vertices[p, 2], vertices[q, 2]
                if (zp <= h) != (zq <= h) and ends < 2:
                    t = (h - zp) / (zq - zp)
                    end[ends, 0] = vertices[p, 0] + t * (vertices[q, 0] - vertices[p, 0])
                    end[ends, 1] = vertices[p, 1] + t * (vertices[q, 1] - vertices[p, 1])
                    ends += 1
            if ends < 2:
                continue
            dx, dy = end[1, 0] - end[0, 0], end[1, 1] - end[0, 1]
            steps = int(np.ceil(4.0 * max(abs(dx), abs(dy)))) + 1
            for s in range(steps + 1):
                j = int(np.floor(end[0, 0] + dx * s / steps)) - first[1]
                i = int(np.floor(end[0, 1] + dy * s / steps)) - first[0]
                if 0 <= i < rows and 0 <= j < columns:
                    marks[i, j] |= np.uint32(1) << np.uint32(n)
