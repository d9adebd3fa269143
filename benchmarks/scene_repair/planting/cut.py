"""Cutting areas out of meshes: exactly along an outline, or whole triangles at a time."""

from dataclasses import replace
from typing import Any

import manifold3d
import numpy as np
from scipy.spatial import KDTree

from vlnpe.formats.core.arrays import Array, Mask
from vlnpe.formats.core.geometry import triangle_cross

from .glb import Part
from .shapes import Outline

# Clipping keeps eight decimals; points nearer than this are one.
SAME_M = 2e-6
# What clipping leaves that is smaller than this is rounding.
CRUMB_M2 = 1e-10


def cut_exactly(part: Part, chosen: Mask, outline: Outline) -> Part:
    """Return the part without what lies inside the outline, seen from above.

    Args:
        part: to cut.
        chosen: (F,) faces that may be cut.
        outline: what to take out.

    Triangles that share an edge are cut at the same points of it, so no seams open beside the hole.
    """
    corners = part.points_m[part.faces][..., :2]
    lower, upper = outline.bounds_m()
    near = chosen & np.all((corners.max(axis=1) >= lower) & (corners.min(axis=1) <= upper), axis=1)
    if not near.any():
        return part
    away = _section(outline.rings)
    pieces: list[Array] = []
    parents: list[int] = []
    changed = np.zeros(len(part.faces), dtype=bool)
    for face in np.flatnonzero(near):
        triangle = corners[face]
        ab, ac = triangle[1] - triangle[0], triangle[2] - triangle[0]
        doubled = ab[0] * ac[1] - ab[1] * ac[0]
        if abs(doubled) < CRUMB_M2:
            continue
        turned = triangle if doubled > 0 else triangle[::-1]
        whole = _section([turned])
        rest = whole - away
        if whole.area() - rest.area() < CRUMB_M2:
            continue
        changed[face] = True
        for piece in _triangles(rest):
            pieces.append(piece if doubled > 0 else piece[::-1])
            parents.append(int(face))
    return _rebuilt(part, changed, pieces, parents)


def cut_whole(part: Part, chosen: Mask, outline: Outline) -> Part:
    """Return the part without the chosen triangles whose middle lies inside the outline."""
    middle = part.points_m[part.faces].mean(axis=1)[:, :2]
    gone = chosen.copy()
    gone[chosen] = outline.contains(middle[chosen])
    if not gone.any():
        return part
    return replace(part, faces=part.faces[~gone])


def _section(rings: list[Array]) -> manifold3d.CrossSection:
    loops: Any = [np.ascontiguousarray(ring) for ring in rings]
    return manifold3d.CrossSection(loops, manifold3d.FillRule.EvenOdd)


def _triangles(section: manifold3d.CrossSection) -> list[Array]:
    """Return the triangles (3, 2), counter-clockwise."""
    loops: Any = section.to_polygons()
    if not len(loops):
        return []
    triangles: Any = manifold3d.triangulate(loops, 1e-9, True)
    points = np.concatenate([np.asarray(loop) for loop in loops])
    return list(points[np.asarray(triangles)])


def _rebuilt(
    part: Part,
    changed: Mask,
    pieces: list[Array],
    parents: list[int],
) -> Part:
    """Return the part with its changed faces replaced by triangles `kept` of the same planes."""
    if not changed.any():
        return part
    if not pieces:
        return replace(part, faces=part.faces[~changed])
    flat = np.concatenate(pieces)
    parent = np.repeat(parents, 3)
    tri = part.faces[parent]
    weight = _barycentric(part.points_m[tri][..., :2], flat)
    # A corner of the old triangle stays that vertex.
    corner = weight.argmax(axis=1)
    corner_at = part.points_m[tri[np.arange(len(tri)), corner]]
    old = np.linalg.norm(corner_at[:, :2] - flat, axis=1) < SAME_M
    index = tri[np.arange(len(tri)), corner].copy()
    fresh = np.flatnonzero(~old)
    points = np.einsum("nk,nkc->nc", weight[fresh], part.points_m[tri[fresh]])
    # Neighbours of one plane meet in one point; attributes may differ between them at seams.
    points = _merged(points)
    others = {
        name: np.einsum("nk,nkc->nc", weight[fresh], values[tri[fresh]]).astype(np.float32)
        for name, values in part.others.items()
    }
    index[fresh] = len(part.points_m) + np.arange(len(fresh))
    faces = np.concatenate([part.faces[~changed], index.reshape(-1, 3)])
    joint = np.concatenate([part.points_m, points])
    # Merging may close the smallest crumbs.
    sound = np.linalg.norm(triangle_cross(joint[faces]), axis=1) > CRUMB_M2
    sound[: int((~changed).sum())] = True
    return replace(
        part,
        points_m=joint,
        faces=faces[sound],
        others={n: np.concatenate([v, others[n]]) for n, v in part.others.items()},
    )


def _barycentric(triangles: Array, points: Array) -> Array:
    a, b, c = (triangles[:, k] for k in range(3))
    x, y = points.T
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    u = ((b[:, 0] - x) * (c[:, 1] - y) - (b[:, 1] - y) * (c[:, 0] - x)) / area
    v = ((c[:, 0] - x) * (a[:, 1] - y) - (c[:, 1] - y) * (a[:, 0] - x)) / area
    return np.stack([u, v, 1 - u - v], axis=1)


def _merged(points: Array) -> Array:
    """Return the points with those nearer than `SAME_M` made equal."""
    if not len(points):
        return points
    tree = KDTree(points)
    first = np.arange(len(points))
    for a, b in sorted(tree.query_pairs(SAME_M)):
        first[b] = min(first[b], first[a])
    return points[first]
