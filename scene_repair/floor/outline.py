"""Trace outlines of faces and cells as closed polygons that keep the vertices exactly."""

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.grid import GridSpec


def trace_loops(edges: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Chain directed edges (E, 2), balanced at each vertex, into closed loops of vertex ids."""
    following: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        following.setdefault(a, []).append(b)
    loops = []
    while following:
        first = next(iter(following))
        loop, here = [], first
        while True:
            loop.append(here)
            options = following[here]
            ahead = options.pop()
            if not options:
                del following[here]
            here = ahead
            if here == first:
                break
        if len(loop) >= 3:
            loops.append(np.array(loop, dtype=np.int64))
    return loops


def face_outline(faces: NDArray[np.int64], signed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the directed border edges (E, 2) of faces seen from above.

    Args:
        faces: (F, 3).
        signed: (F,) whether the projected face runs counter-clockwise; others are turned round.

    Edges shared by two faces cancel; what remains encloses each face's area exactly once, also
    where faces overlap, if polygons are filled by winding number.
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


def cell_polygons(
    cells: NDArray[np.bool_],
    window: tuple[slice, slice],
    grid: GridSpec,
    keep_straight: bool = False,
) -> list[NDArray[np.float64]]:
    """Return world polygons (n, 2) around the true cells; outer ones counter-clockwise.

    Args:
        cells: crop of a map over `grid`.
        window: where the crop lies.
        keep_straight: keep a vertex at every grid node, also along straight runs.
    """
    padded = np.pad(cells, 1)
    columns = padded.shape[1] + 1

    def node(i: NDArray[np.int64], j: NDArray[np.int64]) -> NDArray[np.int64]:
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
        corner = np.array([window[0].start - 1, window[1].start - 1])
        xy = (ij + corner)[:, ::-1] * grid.cell_m + np.asarray(grid.origin_xy_m)
        polygons.append(xy)
    return polygons
