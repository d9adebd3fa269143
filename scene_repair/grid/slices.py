"""Horizontal cuts through a level, which show upright surfaces."""

import numpy as np
from numpy.typing import NDArray

from ...formats.core.kernel import kernel
from ...formats.scene.grid import GridSpec


def slice_marks(
    vertices_m: NDArray[np.float64],
    faces: NDArray[np.int64],
    grid: GridSpec,
    heights_m: NDArray[np.float64],
) -> NDArray[np.uint32]:
    """Return cells whose bit n is set if a surface crosses the plane z = `heights_m[n]` (n < 32).

    Args:
        vertices_m: (V, 3) world.
        faces: (F, 3).
        heights_m: (n,) world heights of the planes.
    """
    scaled = (vertices_m - (*grid.origin_xy_m, 0.0)) / (grid.cell_m, grid.cell_m, 1.0)
    marks = np.zeros(grid.shape, dtype=np.uint32)
    _mark(scaled, np.ascontiguousarray(faces, dtype=np.int64), heights_m.astype(float), marks)
    return marks


@kernel()
def _mark(vertices, faces, heights, marks):
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
            found = 0
            for k in range(3):
                p, q = faces[f, k], faces[f, (k + 1) % 3]
                zp, zq = vertices[p, 2], vertices[q, 2]
                if (zp <= h) != (zq <= h) and found < 2:
                    t = (h - zp) / (zq - zp)
                    end[found, 0] = vertices[p, 0] + t * (vertices[q, 0] - vertices[p, 0])
                    end[found, 1] = vertices[p, 1] + t * (vertices[q, 1] - vertices[p, 1])
                    found += 1
            if found < 2:
                continue
            dx, dy = end[1, 0] - end[0, 0], end[1, 1] - end[0, 1]
            steps = int(np.ceil(4.0 * max(abs(dx), abs(dy)))) + 1
            for s in range(steps + 1):
                j = int(np.floor(end[0, 0] + dx * s / steps))
                i = int(np.floor(end[0, 1] + dy * s / steps))
                if 0 <= i < rows and 0 <= j < columns:
                    marks[i, j] |= np.uint32(1) << np.uint32(n)
