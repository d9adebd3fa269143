"""Primitive shapes as textured triangles.

Texture coordinates are metres on the surface; a material says how large its image is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import I32, I64, Array
from ...formats.core.geometry import arc_length

_QUAD = np.array([[0, 1, 2], [0, 2, 3]])


@dataclass(frozen=True)
class Triangles:
    """A soup of textured triangles.

    Attributes:
        corners: (F, 3, 3) [m].
        uv: (F, 3, 2) [m] on the surface, v up.
        material: (F,) int32.
    """

    corners: Array
    uv: Array
    material: I32

    def moved(self, yaw_rad: float = 0.0, offset_m: ArrayLike = (0.0, 0.0, 0.0)) -> "Triangles":
        """Return this turned about z, then shifted."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        offset = np.asarray(offset_m, dtype=np.float64)
        return replace(self, corners=self.corners @ rotation.T + offset)

    def tilted(self, roll_rad: float, about_m: ArrayLike) -> "Triangles":
        """Return this turned about the x axis through `about_m` (3,)."""
        c, s = np.cos(roll_rad), np.sin(roll_rad)
        rotation = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
        pivot = np.asarray(about_m, dtype=np.float64)
        return replace(self, corners=(self.corners - pivot) @ rotation.T + pivot)

    def scaled(self, factors: ArrayLike) -> "Triangles":
        """Return this stretched by factors (3,) about the origin."""
        return replace(self, corners=self.corners * np.asarray(factors, dtype=np.float64))

    def bounds(self) -> Array:
        """Return (2, 3) lower and upper corner [m]."""
        # Triangles first: numpy takes three times as long for rows of three numbers as of nine.
        rows = self.corners.reshape(-1, 9)
        return np.stack([rows.min(0).reshape(3, 3).min(0), rows.max(0).reshape(3, 3).max(0)])


def join(shapes: Sequence[Triangles]) -> Triangles:
    """Return all triangles of `shapes` (at least one)."""
    names = ("corners", "uv", "material")
    return Triangles(*(np.concatenate([getattr(s, name) for s in shapes]) for name in names))


def _soup(vertices: Array, faces: I64, uv: Array, material: int) -> Triangles:
    return Triangles(vertices[faces], uv[faces], np.full(len(faces), material, dtype=np.int32))


def _halves(a: I64, b: I64, c: I64, d: I64) -> I64:
    """Return the two triangles (2 N, 3) of N quadrilaterals, from the indices of their corners."""
    return np.concatenate([np.stack(half, -1).reshape(-1, 3) for half in ((a, b, c), (a, c, d))])


def _scatter(lower: Array) -> float:
    # Neighbouring boards must not show the same piece of the wood image.
    return float(np.mod(lower @ np.array([12.9898, 78.233, 37.719]), 1.0) * 1.7)


def quad(origin: ArrayLike, right: ArrayLike, up: ArrayLike, material: int) -> Triangles:
    """Return a rectangle from `origin`, where uv is (0, 0), along `right` and `up` (3,) [m]."""
    o, r, u = (np.asarray(a, dtype=np.float64) for a in (origin, right, up))
    w, h = float(np.linalg.norm(r)), float(np.linalg.norm(u))
    vertices = np.stack([o, o + r, o + r + u, o + u])
    uv = np.array([[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]])
    return _soup(vertices, _QUAD, uv, material)


def box(lower: ArrayLike, upper: ArrayLike, material: int) -> Triangles:
    """Return an axis-aligned box; u runs along its longest side, as wood grain does."""
    lo, hi = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    grain = int(np.argmax(hi - lo))
    shift = _scatter(lo)
    parts = []
    for axis in range(3):
        a, b = [k for k in range(3) if k != axis]
        if b == grain:
            a, b = b, a
        for side in (lo, hi):
            vertices = np.empty((4, 3))
            vertices[:, axis] = side[axis]
            vertices[:, a] = [lo[a], hi[a], hi[a], lo[a]]
            vertices[:, b] = [lo[b], lo[b], hi[b], hi[b]]
            uv = np.stack([vertices[:, a] - lo[a] + shift, vertices[:, b] - lo[b] + shift], axis=-1)
            parts.append(_soup(vertices, _QUAD, uv, material))
    return join(parts)


def soft_box(
    lower: ArrayLike,
    upper: ArrayLike,
    radius_m: float,
    material: int,
    puff_m: float = 0.0,
    steps: int = 5,
) -> Triangles:
    """Return a box with rounded edges (a cushion); `puff_m` swells the middle of its top."""
    lo, hi = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    radius = min(radius_m, 0.49 * float((hi - lo).min()))
    inner_lo, inner_hi = lo + radius, hi - radius
    center, half = (lo + hi) / 2, (hi - lo) / 2
    shift = _scatter(lo)
    # Denser near the edges, where the rounding is.
    line = np.sin(np.linspace(-1.0, 1.0, steps + 1) * np.pi / 2)
    s, t = np.meshgrid(line, line, indexing="ij")
    index = np.arange((steps + 1) ** 2).reshape(steps + 1, steps + 1)
    faces = _halves(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    parts = []
    for axis in range(3):
        u_axis, v_axis = [k for k in range(3) if k != axis]
        for sign in (-1.0, 1.0):
            cube = np.empty((index.size, 3))
            cube[:, axis] = sign
            cube[:, u_axis], cube[:, v_axis] = s.ravel(), t.ravel()
            surface = center + cube * half
            core = np.clip(surface, inner_lo, inner_hi)
            out = surface - core
            length = np.linalg.norm(out, axis=1, keepdims=True)
            vertices = core + radius * out / np.maximum(length, 1e-9)
            if puff_m:
                swell = (1 - cube[:, 0] ** 2) * (1 - cube[:, 1] ** 2) * np.maximum(cube[:, 2], 0.0)
                vertices[:, 2] += puff_m * swell
            uv = surface[:, [u_axis, v_axis]] - lo[[u_axis, v_axis]] + shift
            parts.append(_soup(vertices, faces, uv, material))
    return join(parts)


def turned(profile: ArrayLike, center_xy: ArrayLike, material: int, sides: int = 18) -> Triangles:
    """Return a surface of revolution about the vertical through `center_xy` (2,) [m].

    `profile` (N, 2) has rows of (radius, height) [m], from bottom to top.
    """
    line = np.asarray(profile, dtype=np.float64)
    angle = np.linspace(0.0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    vertices = np.empty((len(line), sides + 1, 3))
    vertices[..., :2] = np.asarray(center_xy) + line[:, None, :1] * ring[None]
    vertices[..., 2] = line[:, 1, None]
    uv = np.empty((len(line), sides + 1, 2))
    uv[..., 0] = angle * float(line[:, 0].max())
    uv[..., 1] = arc_length(line)[:, None]
    index = np.arange(len(line) * (sides + 1)).reshape(len(line), sides + 1)
    faces = _halves(index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    return _soup(vertices.reshape(-1, 3), faces, uv.reshape(-1, 2), material)


def cylinder(
    center_xy: ArrayLike, z0: float, z1: float, radius_m: float, material: int, sides: int = 14
) -> Triangles:
    """Return a closed upright cylinder."""
    wall = turned([(radius_m, z0), (radius_m, z1)], center_xy, material, sides)
    lids = []
    for z in (z0, z1):
        lid = turned([(1e-4, z), (radius_m, z)], center_xy, material, sides)
        # Flat texture: wood grain does not run in circles.
        lids.append(Triangles(lid.corners, lid.corners[..., :2].copy(), lid.material))
    return join([wall, *lids])


def ellipsoid(center: ArrayLike, radii: ArrayLike, material: int, steps: int = 8) -> Triangles:
    """Return an ellipsoid with its axes along the coordinate axes."""
    c, r = np.asarray(center, dtype=np.float64), np.asarray(radii, dtype=np.float64)
    angle = np.linspace(-np.pi / 2, np.pi / 2, steps + 1)
    profile = np.stack([np.maximum(np.cos(angle), 1e-4), np.sin(angle)], -1)
    unit = turned(profile, (0.0, 0.0), material)
    return Triangles(unit.corners * r + c, unit.uv * float(r.mean()), unit.material)


def rod(start: ArrayLike, end: ArrayLike, side_m: float, material: int) -> Triangles:
    """Return a square bar between two points (3,) [m]."""
    p, q = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = q - p
    length = float(np.linalg.norm(axis))
    axis = axis / length
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    frame = np.stack([axis, x, np.cross(axis, x)], axis=1)
    bar = box((0.0, -side_m / 2, -side_m / 2), (length, side_m / 2, side_m / 2), material)
    return Triangles(bar.corners @ frame.T + p, bar.uv, bar.material)
