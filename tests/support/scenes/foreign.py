"""Builders of models as converters, games, surveys and simulators leave them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from tests.support.scenes import scans

Parts = dict[str, trimesh.Trimesh]
FAR = np.array([691607.53, 5335984.12, 519.3])
box = scans.box


def room() -> Parts:
    """A furnished room of 6 × 5 × 2.6 m with a slab, walls and a ceiling of boxes."""
    return {
        "floor": box((-3, -2.5, -0.1), (3, 2.5, 0)),
        "ceiling": box((-3, -2.5, 2.6), (3, 2.5, 2.7)),
        "wall1": box((-3.1, -2.5, 0), (-3, 2.5, 2.6)),
        "wall2": box((3, -2.5, 0), (3.1, 2.5, 2.6)),
        "wall3": box((-3, -2.6, 0), (3, -2.5, 2.6)),
        "wall4": box((-3, 2.5, 0), (3, 2.6, 2.6)),
        "table": box((0.5, 0.5, 0.7), (1.7, 1.3, 0.74)),
        "sofa": box((-2.8, -2.3, 0), (-0.9, -1.5, 0.45)),
    }


def shell(width: float = 12.0, depth: float = 9.0, thick: float = 0.2) -> list[trimesh.Trimesh]:
    """Walls without a floor: two rooms with a doorway, windows along one side."""
    height, t = 3.0, thick
    x = [0.0, 3.0, 5.0, 8.0, 10.0, width]
    return [
        box((0, 0, 0), (t, depth, height)),
        box((width - t, 0, 0), (width, depth, height)),
        box((0, depth - t, 0), (width, depth, height)),
        box((0, 0, 0), (width, t, 1.0)),
        box((0, 0, 2.2), (width, t, height)),
        *[box((x[k], 0, 1.0), (x[k + 1], t, 2.2)) for k in (0, 2, 4)],
        box((6, 0, 0), (6 + t, 4, height)),
        box((6, 5, 0), (6 + t, depth, height)),
        box((6, 4, 2.1), (6 + t, 5, height)),
    ]


def write(
    parts: Parts | Sequence[trimesh.Trimesh],
    path: Path,
    *,
    y_up: bool = False,
    generator: str = "",
    shift: Any = (0, 0, 0),
) -> Path:
    """Write named nodes; `generator` takes the place of trimesh's name in a GLB."""
    scene = trimesh.Scene()
    if not isinstance(parts, dict):
        parts = {"model": scans.joined(list(parts))}
    for name, part in parts.items():
        mesh = part.copy()
        mesh.apply_translation(shift)
        if y_up:
            mesh.apply_transform(scans.TO_Y_UP)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    if path.suffix == ".ply":
        scene.to_mesh().export(str(path))
    else:
        scene.export(str(path))
    if generator:
        own = b"https://github.com/mikedh/trimesh"
        path.write_bytes(path.read_bytes().replace(own, generator.encode().ljust(len(own))))
    return path


def write_usd(parts: Parts, path: Path, shift: np.ndarray, unit_m: float) -> None:
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, unit_m)
    root = UsdGeom.Xform.Define(stage, "/Root")
    root.AddTranslateOp().Set(Gf.Vec3d(*map(float, shift)))
    for name, part in parts.items():
        mesh = UsdGeom.Mesh.Define(stage, f"/Root/{name}")
        mesh.CreatePointsAttr([tuple(map(float, p)) for p in part.vertices])
        mesh.CreateFaceVertexCountsAttr([3] * len(part.faces))
        mesh.CreateFaceVertexIndicesAttr(part.faces.ravel().tolist())
    stage.Save()
