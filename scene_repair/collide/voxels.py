"""Exact voxelisation: triangles are clipped to voxels, which remember the surface's tight extent.

The tight extent lets collision boxes end where the surface ends instead of at the voxel's border,
so a doorway keeps its width.
"""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import I32, I64, U8, Array, Mask
from ...formats.process.kernel import called, kernel
from ...formats.scene.grid import GridSpec

# Extents are stored in 1/250 of a voxel: 0.2 mm at 5 cm.
STEPS = 250


@dataclass(frozen=True)
class Voxels:
    """Occupied voxels above a floor.

    Attributes:
        grid, z0_m: horizontal cells, whose side voxels have, and world height of layer 0's bottom.
        lower, upper: (rows, columns, layers, 3) uint8 extent (x, y, z) of what lies in a voxel, in
            1/`STEPS` of its side from its lower corner; upper = 0 in z means empty.
        owner: (rows, columns, layers) int32 owner of a face in the voxel, −1 = none.
    """

    grid: GridSpec
    z0_m: float
    lower: U8
    upper: U8
    owner: I32

    @property
    def occupied(self) -> Mask:
        """Return (rows, columns, layers) bool."""
        return self.upper[..., 2] > 0


def voxelise(
    vertices_m: Array,
    faces: I64,
    face_owner: I32,
    grid: GridSpec,
    *,
    z0_m: float,
    layers: int,
    cut_below_m: Array,
    cut_above_m: Array,
) -> Voxels:
    """Clip every face to the voxels it passes through.

    Args:
        vertices_m, faces: (V, 3) world and (F, 3).
        face_owner: (F,) what the faces belong to, −1 = nothing.
        z0_m, layers: bottom of the lowest layer, and how many of height `grid.cell_m` there are.
        cut_below_m, cut_above_m: (rows, columns) world heights between which faces are kept.
    """
    side = grid.cell_m
    scaled = (vertices_m - (*grid.origin_xy_m, z0_m)) / side
    shape = (*grid.shape, layers, 3)
    lower = np.full(shape, STEPS, dtype=np.uint8)
    upper = np.zeros(shape, dtype=np.uint8)
    owner = np.full(shape[:3], -1, dtype=np.int32)
    _clip_all(
        scaled,
        np.ascontiguousarray(faces, dtype=np.int64),
        np.ascontiguousarray(face_owner, dtype=np.int32),
        (np.stack([cut_below_m, cut_above_m]) - z0_m) / side,
        (lower, upper),
        owner,
        # Not constants in the kernel: those it calls would be compiled for each axis.
        (0, 1, 2),
    )
    return Voxels(grid, z0_m, lower, upper, owner)


# Compiled code copies element by element: array slices would double its compile time.
@called()
def _cut(polygon, count, axis, value, sign, out):
    """Clip a convex polygon by a plane across `axis` (Sutherland and Hodgman, 1974).

    Keeps what lies above `value` for sign 1.0, below for −1.0.
    """
    corners = 0
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        dk = sign * (polygon[k, axis] - value)
        dm = sign * (polygon[m, axis] - value)
        if dk >= 0.0:
            for a in range(3):
                out[corners, a] = polygon[k, a]
            corners += 1
        if (dk > 0.0 and dm < 0.0) or (dk < 0.0 and dm > 0.0):
            t = dk / (dk - dm)
            for a in range(3):
                out[corners, a] = polygon[k, a] + t * (polygon[m, a] - polygon[k, a])
            out[corners, axis] = value
            corners += 1
    return corners


@called()
def _ends(polygon, count, axis):
    low, high = polygon[0, axis], polygon[0, axis]
    for k in range(1, count):
        low = min(low, polygon[k, axis])
        high = max(high, polygon[k, axis])
    return low, high


@called()
def _slab_range(polygon, count, axis, size):
    low, high = _ends(polygon, count, axis)
    first = int(np.floor(low))
    # A face that only touches the next slab's border does not enter it.
    last = max(int(np.ceil(high)) - 1, first)
    return max(first, 0), min(last, size - 1)


@called()
def _slab(polygon, count, axis, low, high, scratch, out):
    corners = _cut(polygon, count, axis, low, 1.0, scratch)
    if corners == 0:
        return 0
    return _cut(scratch, corners, axis, high, -1.0, out)


@called()
def _mark(polygon, count, axis, base, extent, voxel):
    """Widen the stored extent of a voxel (i, j, k) along one axis by what lies in it."""
    lower, upper = extent
    i, j, k = voxel
    low, high = _ends(polygon, count, axis)
    first = min(max(int(np.floor((low - base) * STEPS)), 0), STEPS - 1)
    last = min(max(int(np.ceil((high - base) * STEPS)), first + 1), STEPS)
    if first < lower[i, j, k, axis]:
        lower[i, j, k, axis] = first
    if last > upper[i, j, k, axis]:
        upper[i, j, k, axis] = last


@kernel()
def _clip_all(vertices, faces, face_owner, cut, extent, owner, axes):
    x, y, z = axes
    rows, columns, layers = owner.shape
    triangle, scratch = np.empty((3, 3)), np.empty((16, 3))
    in_column, in_cell = np.empty((16, 3)), np.empty((16, 3))
    in_reach, in_voxel = np.empty((16, 3)), np.empty((16, 3))
    for f in range(len(faces)):
        for k in range(3):
            for a in range(3):
                triangle[k, a] = vertices[faces[f, k], a]
        j0, j1 = _slab_range(triangle, len(triangle), x, columns)
        for j in range(j0, j1 + 1):
            n = _slab(triangle, len(triangle), x, float(j), float(j + 1), scratch, in_column)
            if n == 0:
                continue
            i0, i1 = _slab_range(in_column, n, y, rows)
            for i in range(i0, i1 + 1):
                m = _slab(in_column, n, y, float(i), float(i + 1), scratch, in_cell)
                if m == 0:
                    continue
                m = _slab(in_cell, m, z, cut[0, i, j], cut[1, i, j], scratch, in_reach)
                if m == 0:
                    continue
                k0, k1 = _slab_range(in_reach, m, z, layers)
                for k in range(k0, k1 + 1):
                    q = _slab(in_reach, m, z, float(k), float(k + 1), scratch, in_voxel)
                    if q > 0:
                        _mark(in_voxel, q, x, float(j), extent, (i, j, k))
                        _mark(in_voxel, q, y, float(i), extent, (i, j, k))
                        _mark(in_voxel, q, z, float(k), extent, (i, j, k))
                        if face_owner[f] >= 0:
                            owner[i, j, k] = face_owner[f]
