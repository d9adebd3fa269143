"""Vertical sampling: all heights at which the line through a cell's centre meets a face.

This turns a triangle soup of any quality into something that can be reasoned about: per cell, the
sorted list of surfaces from the lowest to the highest.
"""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I32, I64, Array
from ...formats.core.errors import SceneError
from ...formats.process.kernel import kernel
from ...formats.scene.grid import GridSpec

# Hits take 40 bytes each while they are sorted; tests of a cell with a face, a nanosecond or two.
MAX_HITS, MAX_TESTS = 200_000_000, 20_000_000_000
FACES_AT_ONCE, CELLS_AT_ONCE = 1_000_000, 10_000
# So many hits of a cell are sorted by insertion; its time grows with their square.
INSERTED = 64


@dataclass(frozen=True)
class Columns:
    """Surface heights `z` (N,) [m] per cell, sorted upwards, and the triangles (N,) that were hit.

    Hits of cell i = row * columns + column are `start[i]:start[i + 1]`.
    """

    grid: GridSpec
    start: I64
    z: F32
    face: I32

    @property
    def cell(self) -> I64:
        """Return the cell index (N,) of every hit."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))


def sample_columns(vertices_m: Array, faces: I64, grid: GridSpec) -> Columns:
    """Intersect the vertical lines through all cell centres with faces (F, 3) of vertices (V, 3).

    Raises:
        SceneError: so many surfaces lie above each other that time or memory would not do.
    """
    scaled = (vertices_m - (*grid.origin_xy_m, 0.0)) / (grid.cell_m, grid.cell_m, 1.0)
    faces = np.ascontiguousarray(faces, dtype=np.int64)
    tests = _cell_tests(scaled, faces, grid)
    if tests > MAX_TESTS:
        raise SceneError(
            f"its faces cover {tests:,} cells of {grid.cell_m:g} m in total, counting "
            f"overlapping ones each time; valid: up to {MAX_TESTS:,} (cut it into parts)"
        )
    counts = np.zeros(grid.rows * grid.columns + 1, dtype=np.int64)
    empty_z, empty_face = np.empty(0, dtype=np.float32), np.empty(0, dtype=np.int32)
    _raster(scaled, faces, grid.shape, counts, empty_z, empty_face, False)
    start = np.concatenate([[0], np.cumsum(counts[:-1])])
    if start[-1] > MAX_HITS:
        raise SceneError(
            f"its surfaces meet the vertical lines through cells of {grid.cell_m:g} m "
            f"{int(start[-1]):,} times; valid: up to {MAX_HITS:,} (cut it into parts)"
        )
    cursor = start.copy()
    z = np.empty(start[-1], dtype=np.float32)
    face = np.empty(start[-1], dtype=np.int32)
    _raster(scaled, faces, grid.shape, cursor, z, face, True)
    _sort(start, z, face)
    crowded = np.diff(start) > INSERTED
    if crowded.any():
        cell = np.repeat(np.arange(len(crowded)), np.diff(start))
        hits = np.flatnonzero(crowded[cell])
        order = hits[np.lexsort((z[hits], cell[hits]))]
        z[hits], face[hits] = z[order], face[order]
    return Columns(grid, start, z, face)


def _cell_tests(scaled: Array, faces: I64, grid: GridSpec) -> int:
    """Count the cells in the bounding rectangles of all faces; `scaled` is in cells."""
    total = 0.0
    for first in range(0, len(faces), FACES_AT_ONCE):
        corners = scaled[faces[first : first + FACES_AT_ONCE], :2]
        limits = (grid.columns, grid.rows)
        sides = np.clip(corners.max(axis=1), 0, limits) - np.clip(corners.min(axis=1), 0, limits)
        total += float((sides[:, 0] * sides[:, 1]).sum())
    return int(total)


def top_faces(vertices_m: Array, faces: I64, corner_uv: F32, grid: GridSpec) -> tuple[I32, F32]:
    """Return the topmost face at each cell's centre, −1 = none, and its texture coordinates there.

    Vertices are (V, 3) in the world, faces (F, 3), their coordinates (F, 3, 2); results are
    (rows, columns) and (rows, columns, 2).
    """
    columns = sample_columns(vertices_m, faces, grid)
    face = np.full(grid.shape, -1, dtype=np.int32)
    uv = np.zeros((*grid.shape, 2), dtype=np.float32)
    end = columns.start[1:]
    hit = np.flatnonzero(end > columns.start[:-1])
    top, lowest = end[hit] - 1, columns.start[hit]
    # Of faces in one place the first is taken.
    while (same := (top > lowest) & (columns.z[top - 1] == columns.z[top])).any():
        top -= same
    face.ravel()[hit] = columns.face[top]
    scaled = (vertices_m[:, :2] - grid.origin_xy_m) / grid.cell_m
    # What all of them need would not fit into a processor's cache.
    for first in range(0, len(hit), CELLS_AT_ONCE):
        cell = hit[first : first + CELLS_AT_ONCE]
        f = face.ravel()[cell]
        row, column = np.divmod(cell, grid.columns)
        (ax, ay), (bx, by), (cx, cy) = (scaled[faces[f, k]].T for k in range(3))
        x, y = column + 0.5, row + 0.5
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        u = (((bx - x) * (cy - y) - (by - y) * (cx - x)) / area)[:, None]
        v = (((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area)[:, None]
        corners = corner_uv[f]
        uv.reshape(-1, 2)[cell] = (
            u * corners[:, 0] + v * corners[:, 1] + (1.0 - u - v) * corners[:, 2]
        )
    return face, uv


@kernel()
def _sort(start, z, face):
    """Sort the hits of each cell upwards, keeping the order of equal ones; not in crowded cells."""
    for cell in range(len(start) - 1):
        first, end = start[cell], start[cell + 1]
        if end - first > INSERTED:
            continue
        for k in range(first + 1, end):
            height, hit = z[k], face[k]
            m = k
            while m > first and z[m - 1] > height:
                z[m], face[m] = z[m - 1], face[m - 1]
                m -= 1
            z[m], face[m] = height, hit


@kernel()
def _raster(vertices, faces, shape, cursor, z_out, face_out, fill):
    """Count hits per cell, or write them at each cell's cursor.

    A centre on a shared edge may count for both triangles, which does no harm; it is never lost.
    """
    rows, columns = shape
    for f in range(len(faces)):
        ax, ay, az = vertices[faces[f, 0]]
        bx, by, bz = vertices[faces[f, 1]]
        cx, cy, cz = vertices[faces[f, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        j0 = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0)
        j1 = min(int(np.floor(max(ax, bx, cx) - 0.5)), columns - 1)
        i0 = max(int(np.ceil(min(ay, by, cy) - 0.5)), 0)
        i1 = min(int(np.floor(max(ay, by, cy) - 0.5)), rows - 1)
        for i in range(i0, i1 + 1):
            y = i + 0.5
            for j in range(j0, j1 + 1):
                x = j + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and w >= -1e-12:
                    cell = i * columns + j
                    k = cursor[cell]
                    cursor[cell] = k + 1
                    if fill:
                        z_out[k] = u * az + v * bz + w * cz
                        face_out[k] = f
