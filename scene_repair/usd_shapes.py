"""The surfaces of USD's plain shapes: cubes, planes, cylinders and spheres."""

# usd-core builds its modules at run time and ships no stubs, so no attribute of them is known.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from .polygons import triangulate

SIDES = 24
TIME = Usd.TimeCode.EarliestTime()
# Cyclic turns that bring z to the named axis.
TURNS = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}
Shape = tuple[NDArray[np.float64], NDArray[np.int64]]


def simple_shape(prim: Usd.Prim) -> Shape | None:
    """Points (P, 3) and outward triangles (T, 3) of a plain shape, None if it is none."""

    def size(name: str, default: float) -> float:
        value = prim.GetAttribute(name).Get(TIME)
        return float(value) if value is not None and np.isfinite(value) else default

    if prim.IsA(UsdGeom.Cube):
        half = size("size", 2.0) / 2
        square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return _turned(np.full(2, half), np.stack([square, square]))
    turn = TURNS.get(str(prim.GetAttribute("axis").Get(TIME)), TURNS["Z"])
    angle = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if prim.IsA(UsdGeom.Plane):
        half = np.array([size("width", 2.0), size("length", 2.0)]) / 2
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        points = np.column_stack([corners, np.zeros(4)])
        return points[:, turn], np.array([[0, 1, 2], [0, 2, 3]])
    if prim.IsA(UsdGeom.Cylinder):
        rim = size("radius", 1.0) * circle
        points, faces = _turned(np.full(2, size("height", 2.0) / 2), np.stack([rim, rim]))
        return points[:, turn], faces
    if prim.IsA(UsdGeom.Sphere):
        radius = size("radius", 1.0)
        tilt = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)[1:-1]
        rings = radius * np.cos(tilt)[:, None, None] * circle
        return _turned(radius * np.sin(tilt), rings)
    return None


def _turned(height: NDArray[np.float64], rings: NDArray[np.float64]) -> Shape:
    """Rings (R, n, 2) above each other as a closed surface; a single height counts both ways."""
    height = height * [-1, 1] if len(height) == 2 else height
    count, sides = rings.shape[:2]
    points = np.concatenate(
        [np.column_stack([r, np.full(sides, h)]) for r, h in zip(rings, height, strict=True)]
    )
    around = np.arange(sides)
    after = np.roll(around, -1)
    quads = [
        np.stack([around, after, after + sides, around + sides], axis=1) + sides * k
        for k in range(count - 1)
    ]
    caps = np.concatenate([around[::-1], around + sides * (count - 1)])
    indices = np.concatenate([np.concatenate(quads).ravel(), caps])
    counts = np.array([4] * (sides * (count - 1)) + [sides, sides])
    corners, _ = triangulate(points, counts, indices)
    return points, indices[corners]
