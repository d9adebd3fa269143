"""Triangulate USD's primitive shapes: cubes, planes, cylinders, cones, capsules, spheres."""

from collections.abc import Callable

import numpy as np
from pxr import Usd, UsdGeom

from ...formats.core.arrays import I64, Array
from ...formats.core.geometry import triangle_areas

SIDES = 24
TIME = Usd.TimeCode.EarliestTime()
# Cyclic turns that bring z to the named axis.
TURNS = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}
# Where a plane's width and length lie, by the axis that it faces (UsdGeomPlane); the rest is 0.
PLANE_SIDES = {"X": (2, 1), "Y": (0, 2), "Z": (0, 1)}
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
Shape = tuple[Array, I64]


def simple_shape(prim: Usd.Prim) -> Shape | None:
    """Return points (P, 3) and outward triangles (T, 3) of a primitive shape; None for others."""

    def size(name: str, default: float) -> float:
        value = prim.GetAttribute(name).Get(TIME)
        return float(value) if value is not None and np.isfinite(value) else default

    if prim.IsA(UsdGeom.Cube):
        half = size("size", 2.0) / 2
        return _swept(np.array([-half, half]), np.full(2, half), SQUARE)
    axis = str(prim.GetAttribute("axis").Get(TIME))
    axis = axis if axis in TURNS else "Z"
    if prim.IsA(UsdGeom.Plane):
        return _plane(size("width", 2.0), size("length", 2.0), axis)
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile = _profile(prim, size)
    if profile is None:
        return None
    points, faces = _swept(*profile, circle)
    return points[:, TURNS[axis]], faces


def _profile(prim: Usd.Prim, size: Callable[[str, float], float]) -> tuple[Array, Array] | None:
    """Return heights and radii of the rings of a round shape along its axis, lowest first."""
    if prim.IsA(UsdGeom.Sphere):
        return _rounded(0.0, size("radius", 1.0), size("radius", 1.0))
    if prim.IsA(UsdGeom.Capsule):
        return _rounded(size("height", 1.0), size("radius", 0.5), size("radius", 0.5))
    if prim.IsA(UsdGeom.Capsule_1):
        return _rounded(size("height", 1.0), size("radiusBottom", 0.5), size("radiusTop", 0.5))
    ends = np.array([-0.5, 0.5]) * size("height", 2.0)
    if prim.IsA(UsdGeom.Cone):
        return ends, np.array([size("radius", 1.0), 0.0])
    if prim.IsA(UsdGeom.Cylinder):
        return ends, np.full(2, size("radius", 1.0))
    if prim.IsA(UsdGeom.Cylinder_1):
        return ends, np.array([size("radiusBottom", 1.0), size("radiusTop", 1.0)])
    return None


def _rounded(height: float, bottom: float, top: float) -> tuple[Array, Array]:
    """Return a truncated cone tangent to the spheres that round its ends; a sphere without height.

    The rings where they meet have the radii `bottom` and `top` and are `height` apart.
    """
    slope = (bottom - top) / height if height > 0 else 0.0
    stretch = np.hypot(1.0, slope)
    touch = np.arctan(slope)
    grid = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)
    below, above = np.append(grid[grid < touch], touch), np.append(touch, grid[grid > touch])
    if height <= 0:
        above = above[1:]
    heights = [
        -height / 2 + bottom * (stretch * np.sin(below) - slope),
        height / 2 + top * (stretch * np.sin(above) - slope),
    ]
    radii = np.concatenate([bottom * stretch * np.cos(below), top * stretch * np.cos(above)])
    radii[[0, -1]] = 0.0
    return np.concatenate(heights), radii


def _plane(width: float, length: float, axis: str) -> Shape:
    points = np.zeros((4, 3))
    points[:, list(PLANE_SIDES[axis])] = SQUARE * (width / 2, length / 2)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    # Towards the axis: z × y and x × z look the other way.
    return points, faces if axis == "Z" else faces[:, ::-1]


def _swept(heights: Array, radii: Array, outline: Array) -> Shape:
    """Sweep an outline (n, 2), counter-clockwise, over rings (R heights and radii); closed."""
    count, sides = len(heights), len(outline)
    rings = [
        np.column_stack([r * outline, np.full(sides, h)])
        for h, r in zip(heights, radii, strict=True)
    ]
    points = np.concatenate(rings)
    around = np.arange(sides)
    after = np.roll(around, -1)
    lower = np.stack([around, after, after + sides], axis=1)
    upper = np.stack([around, after + sides, around + sides], axis=1)
    walls = [faces + sides * k for k in range(count - 1) for faces in (lower, upper)]
    cap = np.stack([np.zeros(sides - 2, dtype=int), around[1:-1], around[2:]], axis=1)
    faces = np.concatenate([*walls, cap[:, ::-1], cap + sides * (count - 1)])
    # Where a ring is a point, triangles vanish.
    return points, faces[triangle_areas(points[faces]) > 0]
