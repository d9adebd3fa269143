"""Read triangles, texture coordinates and colours of USD's geometric prims."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdShade

from ...formats.core.arrays import I64, U8, Array, Mask
from ...formats.core.errors import FileFormatError
from ..scan.readings import LookRef
from ..scan.record import linear_to_srgb
from ..scan.soup import Part
from .polygons import triangulate
from .read_materials import Look, StageMaterials
from .read_objects import object_of
from .shapes import simple_shape

MAX_TRIANGLES = 20_000_000
TIME = Usd.TimeCode.EarliestTime()


class PartList:
    """Parts read from `path`, their materials, and how many prims were visited."""

    def __init__(self, path: Path, materials: StageMaterials, warnings: list[str]):
        self.path, self.materials, self.warnings = path, materials, warnings
        self.parts: list[Part[LookRef]] = []
        self.prims = self._triangles = 0

    def warn(self, line: str) -> None:
        """Add a warning, once."""
        if line not in self.warnings:
            self.warnings.append(line)

    def add(
        self,
        named: tuple[str, str],
        points: NDArray[Any],
        faces: NDArray[Any],
        uv: NDArray[Any],
        look: LookRef,
        colors: U8 | None,
    ) -> None:
        """Append one part; raise FileFormatError if there are too many triangles together."""
        self._triangles += len(faces)
        if self._triangles > MAX_TRIANGLES:
            raise FileFormatError(self.path, f"contains more than {MAX_TRIANGLES:,} triangles")
        used, faces = np.unique(faces, return_inverse=True)
        faces = faces.reshape(-1, 3).astype(np.int32)
        uv = np.nan_to_num(uv.astype(np.float32), posinf=0.0, neginf=0.0)
        self.parts.append(Part(*named, points[used], faces, uv, look, colors))


def add_gprim(gprim: UsdGeom.Gprim, to_world: Array, instance: str, parts: PartList) -> None:
    """Add the triangles of a prim; `to_world` (4, 4) acts on row vectors."""
    prim = gprim.GetPrim()
    name, category = object_of(prim)
    named = (f"{instance}{name}", category)
    if prim.IsA(UsdGeom.Mesh):
        _add_mesh(UsdGeom.Mesh(prim), to_world, named, parts)
        return
    shape = simple_shape(prim)
    if shape is None:
        parts.warn(f"{prim.GetPath()}: {prim.GetTypeName()} is not a surface; skipped")
        return
    points, faces = shape
    if np.linalg.det(to_world[:3, :3]) < 0:
        faces = faces[:, ::-1]
    points = points @ to_world[:3, :3] + to_world[3, :3]
    color, _ = _display_color(gprim)
    look = parts.materials.of(_bound(prim))
    ref = look.ref
    if color is not None and len(color) == 1 and not _bound(prim):
        ref = LookRef("display", _rgb(color[0]))
    parts.add(named, points, faces, np.zeros((len(faces), 3, 2)), ref, None)


def _bound(prim: Usd.Prim) -> UsdShade.Material | None:
    material = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
    return material if material else None


def _add_mesh(mesh: UsdGeom.Mesh, to_world: Array, named: tuple[str, str], parts: PartList) -> None:
    prim = mesh.GetPrim()
    points = np.array(mesh.GetPointsAttr().Get(TIME) or np.zeros((0, 3)), dtype=np.float64)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(TIME) or [], dtype=np.int64)
    indices = np.array(mesh.GetFaceVertexIndicesAttr().Get(TIME) or [], dtype=np.int64)
    if not len(points) or not len(counts):
        return
    if (counts < 0).any() or counts.sum() != len(indices):
        parts.warn(
            f"{prim.GetPath()}: {len(indices)} corners, its faces count {counts.sum()}; skipped"
        )
        return
    polygon = np.repeat(np.arange(len(counts)), counts)
    usable = np.ones(len(counts), dtype=bool)
    wrong = (indices < 0) | (indices >= len(points))
    if wrong.any():
        usable[polygon[wrong]] = False
        dropped = int((~usable).sum())
        parts.warn(f"{prim.GetPath()}: {dropped} faces with indices out of range dropped")
    holes = np.array(mesh.GetHoleIndicesAttr().Get(TIME) or [], dtype=np.int64)
    usable[holes[(holes >= 0) & (holes < len(counts))]] = False
    corner, face = _triangles(points, counts, indices, usable)
    mirrored = np.linalg.det(to_world[:3, :3]) < 0
    left = mesh.GetOrientationAttr().Get(TIME) == UsdGeom.Tokens.leftHanded
    if mirrored != left:
        corner = corner[:, ::-1]
    world = points @ to_world[:3, :3] + to_world[3, :3]
    colors, interpolation = _display_color(mesh)
    for look, selected in _by_look(mesh, face, len(counts), parts):
        where = Corners(corner[selected], face[selected], indices, len(points), len(counts))
        uv = _texture_coordinates(prim, look, where, parts)
        ref, painted = look.ref, None
        corner_colors = None
        if colors is not None and not _bound(prim):
            corner_colors = where.spread(colors, interpolation)
        if colors is not None and corner_colors is not None:
            if interpolation == UsdGeom.Tokens.constant:
                ref = LookRef("display", _rgb(colors[0]))
            else:
                srgb = linear_to_srgb(np.clip(corner_colors, 0, 1))
                painted = np.rint(255 * srgb).astype(np.uint8)
        parts.add(named, world, indices[where.corner], uv, ref, painted)


@dataclass(frozen=True)
class Corners:
    """Triangles (T, 3) of polygons `face` (T,) of a mesh, as positions in `indices` (C,).

    `points` and `polygons` are how many the mesh has.
    """

    corner: I64
    face: I64
    indices: I64
    points: int
    polygons: int

    def spread(self, rows: Array, interpolation: str) -> Array | None:
        """Return values (T, 3, k) at the triangles' corners; None if their number does not fit."""
        tokens = UsdGeom.Tokens
        if interpolation == tokens.constant and len(rows):
            return np.broadcast_to(rows[0], (*self.corner.shape, rows.shape[1]))
        if interpolation == tokens.uniform and len(rows) == self.polygons:
            return np.repeat(rows[self.face][:, None], 3, axis=1)
        if interpolation in (tokens.vertex, tokens.varying) and len(rows) == self.points:
            return rows[self.indices[self.corner]]
        if interpolation == tokens.faceVarying and len(rows) == len(self.indices):
            return rows[self.corner]
        return None


def _triangles(points: Array, counts: I64, indices: I64, usable: Mask) -> tuple[I64, I64]:
    """Triangulate the usable polygons only, numbered as among all; see `triangulate`."""
    if usable.all():
        return triangulate(points, counts, indices)
    used = np.flatnonzero(np.repeat(usable, counts))
    corners, owner = triangulate(points, counts[usable], indices[used])
    return used[corners], np.flatnonzero(usable)[owner]


def _by_look(
    mesh: UsdGeom.Mesh, owner: I64, polygons: int, parts: PartList
) -> list[tuple[Look, I64]]:
    """Return the triangles by material: subsets of faces first, the mesh's own for the rest."""
    prim = mesh.GetPrim()
    number = np.zeros(polygons, dtype=np.int64)
    materials = [parts.materials.of(_bound(prim))]
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        selected = np.array(subset.GetIndicesAttr().Get(TIME) or [], dtype=np.int64)
        number[selected[(selected >= 0) & (selected < polygons)]] = len(materials)
        materials.append(parts.materials.of(_bound(subset.GetPrim())))
    if len(materials) == 1:
        return [(materials[0], np.arange(len(owner)))] if len(owner) else []
    of = number[owner]
    return [(materials[k], np.flatnonzero(of == k)) for k in np.unique(of)]


def _texture_coordinates(prim: Usd.Prim, look: Look, where: Corners, parts: PartList) -> Array:
    nothing = np.zeros((len(where.corner), 3, 2))
    if not look.ref.texture:
        return nothing
    api = UsdGeom.PrimvarsAPI(prim)
    primvar = api.FindPrimvarWithInheritance(look.primvar) if look.primvar else None
    if not primvar or not primvar.HasValue():
        kinds = (Sdf.ValueTypeNames.TexCoord2fArray, Sdf.ValueTypeNames.Float2Array)
        candidates = [p for p in api.GetPrimvarsWithValues() if p.GetTypeName() in kinds]
        primvar = candidates[0] if candidates else None
    values = None if primvar is None else primvar.ComputeFlattened(TIME)
    if primvar is None or values is None:
        parts.warn(f"{prim.GetPath()}: has a picture, but no texture coordinates")
        return nothing
    rows = np.array(values, dtype=np.float64).reshape(len(values), -1)[:, :2]
    uv = where.spread(rows, primvar.GetInterpolation())
    if uv is None:
        parts.warn(f"{prim.GetPath()}: {len(rows)} texture coordinates do not fit its faces")
        return nothing
    return uv @ look.to_uv[:, :2].T + look.to_uv[:, 2]


def _display_color(gprim: UsdGeom.Gprim) -> tuple[Array | None, str]:
    primvar = UsdGeom.PrimvarsAPI(gprim.GetPrim()).FindPrimvarWithInheritance("displayColor")
    values = primvar.ComputeFlattened(TIME) if primvar and primvar.HasValue() else None
    # Values of an unknown type come as one opaque object.
    if values is None or not hasattr(values, "__len__") or not len(values):
        return None, ""
    colors = np.nan_to_num(np.array(values, dtype=np.float64).reshape(-1, 3))
    return colors, primvar.GetInterpolation() if len(colors) > 1 else UsdGeom.Tokens.constant


def _rgb(linear: Array) -> tuple[float, float, float]:
    r, g, b = (float(v) for v in linear_to_srgb(np.clip(linear, 0.0, 1.0)))
    return r, g, b
