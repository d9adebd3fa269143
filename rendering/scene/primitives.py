"""Tessellation of MuJoCo's primitive shapes: triangles with normals, in the geom's frame."""

from collections.abc import Callable

import mujoco
import numpy as np

from ...formats.core.arrays import Floats
from ...formats.core.geometry import triangle_cross, triangle_normals

# Corners (F, 3, 3) and unit normals at the corners (F, 3, 3).
Surface = tuple[Floats, Floats]

AROUND = 28  # segments around an axis; normals are smooth, so they show only in silhouettes
ALONG = 7  # rings per quarter of a meridian


def _grid_surface(points: Floats, *, normals: Floats) -> Surface:
    """Return triangles of a (rows, columns, 3) grid of points; front faces face the normals."""
    corners, corner_normals = [], []
    for source, target in ((points, corners), (normals, corner_normals)):
        a, b = source[:-1, :-1], source[:-1, 1:]
        c, d = source[1:, :-1], source[1:, 1:]
        target.append(np.stack([a, c, d], axis=-2).reshape(-1, 3, 3))
        target.append(np.stack([a, d, b], axis=-2).reshape(-1, 3, 3))
    triangles, smooth = np.concatenate(corners), np.concatenate(corner_normals)
    # Poles collapse one side of their quads.
    keep = np.linalg.norm(triangle_cross(triangles), axis=-1) > 1e-12
    return triangles[keep], smooth[keep]


def flat(triangles: Floats) -> Surface:
    """Return triangles (F, 3, 3) with their face normals."""
    return triangles, np.repeat(triangle_normals(triangles)[:, None], 3, axis=1)


def _unit_rings() -> tuple[Floats, Floats]:
    polar = np.linspace(0.0, np.pi, 2 * ALONG + 1)
    angle = np.linspace(0.0, 2 * np.pi, AROUND + 1)
    return polar, angle


def _revolve(*, radius: Floats, height: Floats, normal_r: Floats, normal_z: Floats) -> Surface:
    """Return the surface of revolution about z of a profile (R,) from top to bottom."""
    angle = np.linspace(0.0, 2 * np.pi, AROUND + 1)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    up = np.array([0.0, 0.0, 1.0])
    points = radius[:, None, None] * circle + height[:, None, None] * up
    normals = normal_r[:, None, None] * circle + normal_z[:, None, None] * up
    return _grid_surface(points, normals=normals)


def box(size: Floats) -> Surface:
    """Return a box of half sides (3,) [m]."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    corners = signs * size
    return flat(
        np.array([corners[[q[0], q[i], q[i + 1]]] for q in quads for i in (1, 2)], dtype=float)
    )


def ellipsoid(size: Floats) -> Surface:
    """Return an ellipsoid of half axes (3,) [m]."""
    polar, angle = _unit_rings()
    unit = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(angle),
            np.sin(polar)[:, None] * np.sin(angle),
            np.repeat(np.cos(polar)[:, None], len(angle), axis=1),
        ],
        axis=-1,
    )
    normals = unit / size
    return _grid_surface(
        unit * size, normals=normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    )


def sphere(size: Floats) -> Surface:
    """Return a sphere; `size` starts with its radius [m]."""
    return ellipsoid(np.full(3, size[0]))


def capsule(size: Floats) -> Surface:
    """Return a capsule along z; `size` is radius and half length of the cylindrical part [m]."""
    polar, _ = _unit_rings()
    # The equator appears twice, with the wall between its two copies.
    polar = np.concatenate([polar[: ALONG + 1], polar[ALONG:]])
    shift = np.repeat([size[1], -size[1]], ALONG + 1)
    return _revolve(
        radius=size[0] * np.sin(polar),
        height=size[0] * np.cos(polar) + shift,
        normal_r=np.sin(polar),
        normal_z=np.cos(polar),
    )


def cylinder(size: Floats) -> Surface:
    """Return a cylinder along z; `size` is radius and half length [m]."""
    radius, half = size[0], size[1]
    one, zero = np.ones(2), np.zeros(2)
    ends = np.array([half, -half])
    wall = _revolve(radius=radius * one, height=ends, normal_r=one, normal_z=zero)
    rim = np.array([0.0, radius])
    top = _revolve(radius=rim, height=half * one, normal_r=zero, normal_z=one)
    bottom = _revolve(radius=rim[::-1], height=-half * one, normal_r=zero, normal_z=-one)
    parts = (wall, top, bottom)
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


_GEOM = mujoco.mjtGeom
SHAPES: dict[int, Callable[[Floats], Surface]] = {
    int(_GEOM.mjGEOM_BOX): box,
    int(_GEOM.mjGEOM_SPHERE): sphere,
    int(_GEOM.mjGEOM_ELLIPSOID): ellipsoid,
    int(_GEOM.mjGEOM_CAPSULE): capsule,
    int(_GEOM.mjGEOM_CYLINDER): cylinder,
}


def geom_surface(model: mujoco.MjModel, geom: int) -> Surface:
    """Return triangles and corner normals of a compiled model's geom, in the geom's frame.

    Raises:
        ValueError: the geom's type is not supported (plane, height field, …).
    """
    kind = int(model.geom_type[geom])
    if kind == int(_GEOM.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        start, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        vertices = model.mesh_vert[first : first + count].astype(np.float64)
        return flat(vertices[model.mesh_face[start : start + faces]])
    if kind not in SHAPES:
        raise ValueError(
            f"geom {geom} has type {_GEOM(kind).name}; valid: mesh and "
            + ", ".join(sorted(_GEOM(k).name for k in SHAPES))
        )
    return SHAPES[kind](np.asarray(model.geom_size[geom], dtype=np.float64))
