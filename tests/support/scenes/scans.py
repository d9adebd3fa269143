"""Scans of made-up rooms whose truth is known, with holes cut at will.

World coordinates: z up, metres; the main floor is z = 0. Written as GLB they are turned y up.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from vlnpe.formats.scene.bundle import VisualMesh

Array = NDArray[np.float64]
Inside = Callable[[Array], NDArray[np.bool_]]
TO_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def sheet(
    lower: Sequence[float] | Array,
    upper: Sequence[float] | Array,
    z: float = 0.0,
    step: float = 0.05,
    without: Inside | None = None,
    facing_up: bool = True,
) -> trimesh.Trimesh:
    """A level rectangle of small triangles; those whose centre is `without` are missing."""
    nx = max(1, round((upper[0] - lower[0]) / step))
    ny = max(1, round((upper[1] - lower[1]) / step))
    x, y = np.linspace(lower[0], upper[0], nx + 1), np.linspace(lower[1], upper[1], ny + 1)
    points = np.stack([*np.meshgrid(x, y), np.full((ny + 1, nx + 1), z)], axis=-1).reshape(-1, 3)
    i, j = np.indices((ny, nx)).reshape(2, -1)
    base = i * (nx + 1) + j
    faces = np.concatenate(
        [
            np.stack([base, base + 1, base + nx + 2], axis=1),
            np.stack([base, base + nx + 2, base + nx + 1], axis=1),
        ]
    )
    if without is not None:
        faces = faces[~without(points[faces].mean(axis=1)[:, :2])]
    if not facing_up:
        faces = faces[:, ::-1]
    mesh = trimesh.Trimesh(points, faces, process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def joined(parts: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return one mesh of all parts."""
    mesh = trimesh.util.concatenate(list(parts))
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def box(lower: Sequence[float], upper: Sequence[float]) -> trimesh.Trimesh:
    """A closed box."""
    return trimesh.creation.box(bounds=[lower, upper])


def walls(
    lower: Sequence[float], upper: Sequence[float], height: float = 2.6, thick: float = 0.1
) -> list[trimesh.Trimesh]:
    """Four walls around a rectangle, outside of it."""
    (x0, y0), (x1, y1) = lower, upper
    return [
        box((x0 - thick, y0 - thick, 0), (x1 + thick, y0, height)),
        box((x0 - thick, y1, 0), (x1 + thick, y1 + thick, height)),
        box((x0 - thick, y0, 0), (x0, y1, height)),
        box((x1, y0, 0), (x1 + thick, y1, height)),
    ]


def table(x: float, y: float, size: float = 1.0, height: float = 0.75) -> list[trimesh.Trimesh]:
    """A table on four thin legs (4 cm) with its corner at x, y."""
    top = box((x, y, height - 0.03), (x + size, y + size, height))
    legs = [
        box((x + a, y + b, 0.0), (x + a + 0.04, y + b + 0.04, height - 0.03))
        for a in (0.05, size - 0.09)
        for b in (0.05, size - 0.09)
    ]
    return [top, *legs]


def room(
    without: Inside | None = None,
    ceiling: bool = True,
    size: tuple[float, float] = (5.0, 4.0),
    more: Sequence[trimesh.Trimesh] = (),
) -> list[trimesh.Trimesh]:
    """One room with its corner at the origin, floor cut by `without`."""
    parts = [sheet((0, 0), size, without=without), *walls((0, 0), size), *more]
    if ceiling:
        parts.append(sheet((0, 0), size, z=2.6, step=0.5, facing_up=False))
    return parts


def two_rooms(door_m: float, without: Inside | None = None) -> list[trimesh.Trimesh]:
    """Rooms x 0…4 and 4.1…8, y 0…4, joined by a doorway in the middle of the wall between."""
    low, high = 2.0 - door_m / 2, 2.0 + door_m / 2
    return [
        sheet((0, 0), (8, 4), without=without),
        *walls((0, 0), (8, 4)),
        box((4.0, 0, 0), (4.1, low, 2.6)),
        box((4.0, high, 0), (4.1, 4, 2.6)),
        box((4.0, low, 2.05), (4.1, high, 2.6)),
        sheet((0, 0), (8, 4), z=2.6, step=0.5, facing_up=False),
    ]


def write_glb(parts: Sequence[trimesh.Trimesh], path: Path) -> Path:
    """Write the parts as one unnamed mesh, as a scanner would."""
    mesh = joined([trimesh.Trimesh(p.vertices, p.faces) for p in parts])
    mesh.apply_transform(TO_Y_UP)
    trimesh.Scene({"geometry_0": mesh}).export(str(path))
    return path


def write_named_glb(parts: dict[str, trimesh.Trimesh], path: Path) -> Path:
    """Write one named node per part; the part `Floor_1` gets a checkered texture."""
    scene = trimesh.Scene()
    for name, part in parts.items():
        mesh = part.copy()
        if name.startswith("Floor"):
            uv = np.asarray(mesh.vertices)[:, :2] / 2.0
            mesh.visual = TextureVisuals(
                uv=uv, material=PBRMaterial(baseColorTexture=checker(), name="tiles")
            )
        mesh.apply_transform(TO_Y_UP)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.export(str(path))
    return path


def checker(squares: int = 8, pixels: int = 256) -> Image.Image:
    """A checkered picture."""
    i, j = np.indices((pixels, pixels)) * squares // pixels
    value = np.where((i + j) % 2, 200, 90).astype(np.uint8)
    return Image.fromarray(np.stack([value, value, value], axis=-1))


def disc(x: float, y: float, radius: float) -> Inside:
    """Inside a disc."""
    return lambda p: np.hypot(p[:, 0] - x, p[:, 1] - y) < radius


def rectangle(lower: Sequence[float], upper: Sequence[float]) -> Inside:
    """Inside an axis-aligned rectangle."""
    return lambda p: np.all((p > np.asarray(lower)) & (p < np.asarray(upper)), axis=1)


def ring(x: float, y: float, inner: float, outer: float) -> Inside:
    """Between two circles."""

    def inside(p: Array) -> NDArray[np.bool_]:
        distance = np.hypot(p[:, 0] - x, p[:, 1] - y)
        return (distance > inner) & (distance < outer)

    return inside


def either(*shapes: Inside) -> Inside:
    """Inside any of the shapes."""
    return lambda p: np.any([shape(p) for shape in shapes], axis=0)


def empty_visual() -> VisualMesh:
    """No triangles, for bundles of which only the collision matters."""
    return VisualMesh(
        np.empty((0, 3), np.float32),
        np.empty((0, 3), np.int32),
        np.empty((0, 3, 2), np.float32),
        np.empty(0, np.int32),
        np.empty(0, np.int32),
    )
