"""Triangulate polygons of any number of corners."""

import mapbox_earcut
import numpy as np

from ...formats.core.arrays import I64, Array, Mask


def triangulate(points: Array, counts: I64, indices: I64) -> tuple[I64, I64]:
    """Triangulate polygons: convex ones as fans, others by ear clipping in their plane.

    Args:
        points: (P, 3).
        counts: (N,) corners of each polygon, their sum is C; below 3 makes no triangle.
        indices: (C,) points of the corners, all in range.

    Returns:
        Triangles (T, 3) as positions in `indices`, and the polygon (T,) of each, ascending.
    """
    starts = np.cumsum(counts) - counts
    triangles, owner = [], []
    for sides in np.unique(counts[counts >= 3]):
        selected = np.flatnonzero(counts == sides)
        corner = starts[selected, None] + np.arange(sides)
        fan = np.stack(
            [np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=1
        )
        if sides == 3:
            triangles.append(corner)
            owner.append(selected)
            continue
        place = points[indices[corner]]
        convex = _convex(place)
        triangles.append(corner[convex][:, fan].reshape(-1, 3))
        owner.append(np.repeat(selected[convex], sides - 2))
        for k in np.flatnonzero(~convex):
            ears = _ears(place[k])
            triangles.append(corner[k][ears])
            owner.append(np.full(len(ears), selected[k]))
    if not triangles:
        return np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    of = np.concatenate(owner)
    order = np.argsort(of, kind="stable")
    return np.concatenate(triangles)[order], of[order]


def _newell(place: Array) -> Array:
    """Return area vectors (…, 3) of polygons (…, n, 3) by Newell's method."""
    local = place - place[..., :1, :]
    return np.cross(local, np.roll(local, -1, axis=-2)).sum(axis=-2)


def _convex(place: Array) -> Mask:
    """Return whether each polygon (n, k, 3) is convex and simple."""
    with np.errstate(invalid="ignore", over="ignore"):
        normal = _newell(place)
        edge = np.roll(place, -1, axis=1) - place
        turn = np.einsum("nkd,nd->nk", np.cross(np.roll(edge, 1, axis=1), edge), normal)
        # A star that winds twice turns one way as well, but its fan covers other ground.
        spoke = place[:, 1:] - place[:, :1]
        fan = np.einsum("nkd,nd->nk", np.cross(spoke[:, :-1], spoke[:, 1:]), normal)
        convex = (turn >= 0).all(axis=1) & (fan >= 0).all(axis=1)
        # Without a plane of their own there is nothing to clip ears in.
        return convex | ~(np.linalg.norm(normal, axis=1) > 0)


def _ears(place: Array) -> I64:
    """Return triangles (t, 3) of one polygon (k, 3) with the polygon's winding."""
    normal = _newell(place)
    across = np.argsort(np.abs(normal))[:2]
    flat = np.ascontiguousarray(place[:, across] - place[0, across])
    ears = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], dtype=np.uint32))
    ears = np.asarray(ears, dtype=np.int64).reshape(-1, 3)
    wound = np.einsum("td,d->t", _newell(place[ears]), normal)
    return np.where((wound < 0)[:, None], ears[:, ::-1], ears)
