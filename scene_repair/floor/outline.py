"""Trace outlines of faces and cells as closed polygons that keep the vertices exactly."""

import numpy as np

from ...formats.core.arrays import I64, Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.morphology import Window


def trace_loops(edges: I64) -> list[I64]:
    """Chain directed edges (E, 2), balanced at each vertex, into closed loops of vertex ids."""
    following: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        following.setdefault(a, []).append(b)
    loops = []
    while following:
        first = next(iter(following))
        loop, vertex = [], first
        while True:
            loop.append(vertex)
            options = following[vertex]
            ahead = options.pop()
            if not options:
                del following[vertex]
            vertex = ahead
            if vertex == first:
                break
        if len(loop) >= 3:
            loops.append(np.array(loop, dtype=np.int64))
    return loops


def face_outline(faces: I64, signed: Mask) -> I64:
    """Return the directed border edges (E, 2) of faces (F, 3) seen from above.

    `signed` (F,) says which run counter-clockwise; others are turned round. Edges shared by two
    faces cancel; what remains encloses each face's area exactly once, also where faces overlap, if
    polygons are filled by winding number.
    """
    turned = np.where(signed[:, None], faces, faces[:, ::-1])
    edges = np.concatenate([turned[:, [0, 1]], turned[:, [1, 2]], turned[:, [2, 0]]])
    low, high = edges.min(axis=1), edges.max(axis=1)
    sign = np.where(edges[:, 0] == low, 1, -1)
    # One number per edge sorts much faster than pairs.
    base = int(high.max()) + 1 if len(high) else 1
    keys, inverse = np.unique(low * base + high, return_inverse=True)
    pairs = np.stack([keys // base, keys % base], axis=1)
    balance = np.bincount(inverse.ravel(), weights=sign, minlength=len(pairs)).astype(np.int64)
    forward = np.repeat(pairs[balance > 0], balance[balance > 0], axis=0)
    backward = np.repeat(pairs[balance < 0][:, ::-1], -balance[balance < 0], axis=0)
    return np.concatenate([forward, backward])


def cell_squares(cells: Mask) -> tuple[I64, I64]:
    """Return the nodes (N, 2), row and column, of true cells, and triangles (T, 3) over them."""
    i, j = np.nonzero(cells)
    width = cells.shape[1] + 1
    base = i * width + j
    quads = np.stack([base, base + 1, base + width + 1, base + width], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    used, inverse = np.unique(triangles, return_inverse=True)
    return np.stack([used // width, used % width], axis=1), inverse.reshape(-1, 3).astype(np.int64)


def cell_strips(cells: Mask) -> tuple[I64, I64]:
    """Return the nodes (N, 2) and triangles (T, 3) of a rectangle over each run of true cells."""
    ends = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, first), (_, stop) = np.nonzero(ends == 1), np.nonzero(ends == -1)
    corners = np.stack([row, first, row, stop, row + 1, stop, row + 1, first], axis=1)
    base = 4 * np.arange(len(row))[:, None]
    faces = np.concatenate([base + np.array(half) for half in ((0, 1, 2), (0, 2, 3))])
    return corners.reshape(-1, 2).astype(np.int64), faces.astype(np.int64)


def cell_polygons(
    cells: Mask, grid: GridSpec, window: Window | None = None, keep_straight: bool = False
) -> list[Array]:
    """Return world polygons (n, 2) around the true cells; outer ones counter-clockwise.

    `cells` is the crop of a map over `grid` at `window`. If `keep_straight`, there is a vertex at
    every grid node, also along straight runs.
    """
    padded = np.pad(cells, 1)
    columns = padded.shape[1] + 1

    def node(i: I64, j: I64) -> I64:
        return i * columns + j

    edges = []
    # For every side of a cell whose neighbour is empty, one edge with the cell on its left.
    for di, dj, a, b in (
        (-1, 0, (0, 0), (0, 1)),
        (0, 1, (0, 1), (1, 1)),
        (1, 0, (1, 1), (1, 0)),
        (0, -1, (1, 0), (0, 0)),
    ):
        neighbour = np.roll(padded, (-di, -dj), axis=(0, 1))
        i, j = np.nonzero(padded & ~neighbour)
        edges.append(np.stack([node(i + a[0], j + a[1]), node(i + b[0], j + b[1])], axis=1))
    polygons = []
    for loop in trace_loops(np.concatenate(edges)):
        ij = np.stack([loop // columns, loop % columns], axis=1).astype(np.float64)
        before, after = np.roll(ij, 1, axis=0), np.roll(ij, -1, axis=0)
        straight = np.all(np.isclose(ij - before, after - ij), axis=1)
        if not keep_straight:
            ij = ij[~straight]
        corner = np.array([w.start for w in window] if window else [0, 0]) - 1
        xy = (ij + corner)[:, ::-1] * grid.cell_m + np.asarray(grid.origin_xy_m)
        polygons.append(xy)
    return polygons
