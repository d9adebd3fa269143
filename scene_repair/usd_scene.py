"""The repaired scene as one USD file: looks, labels and collision, z up, in metres."""

# usd-core builds its modules at run time and ships no stubs, so no attribute of them is known.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade, Vt

from ..formats.errors import FileFormatError
from ..formats.scene_bundle import Floor, LabeledObject, Material, Obstacles, VisualMesh

SEMANTICS = "class"
# A box's corners are numbered by bits x, y, z; quads run counter-clockwise seen from outside.
_BOX_QUADS = np.array(
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
)


def write_usd(
    path: Path,
    visual: VisualMesh,
    materials: tuple[Material, ...],
    labels: tuple[str, ...],
    objects: tuple[LabeledObject, ...],
    levels: list[tuple[Floor, Obstacles]],
) -> None:
    """Write `path` and read it back.

    The visual meshes stand under /World/Visual, one per label and material; invisible colliders
    (purpose `guide`) under /World/Collision: per level the floor as a mesh and the obstacle boxes
    as one mesh. Textures are referenced relative to the file.

    Raises:
        FileFormatError: what was written does not open as intended.
    """
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world.GetPrim()).SetKind(Kind.Tokens.component)
    looks = [_material(stage, k, m) for k, m in enumerate(materials)]
    UsdGeom.Xform.Define(stage, "/World/Visual")
    _visual(stage, visual, looks, materials, labels)
    _objects(stage, objects)
    UsdGeom.Xform.Define(stage, "/World/Collision")
    for k, (floor, obstacles) in enumerate(levels):
        _collider(stage, f"/World/Collision/Floor_{k}", *_floor_mesh(floor), "floor")
        if len(obstacles.center_m):
            _collider(stage, f"/World/Collision/Boxes_{k}", *_box_mesh(obstacles), "obstacle")
    stage.GetRootLayer().Save()
    _check(path)


def _name(text: str, index: int) -> str:
    cleaned = re.sub(r"[^A-Za-z0-9_]", "_", text)
    return f"M{index:03d}_{cleaned}"


def _material(stage: Usd.Stage, index: int, material: Material) -> UsdShade.Material:
    path = f"/World/Looks/{_name(material.name, index)}"
    look = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    linear = _srgb_to_linear(np.array(material.base_color))
    if material.texture is None:
        color.Set(Gf.Vec3f(*(float(v) for v in linear)))
    else:
        reader = UsdShade.Shader.Define(stage, f"{path}/Uv")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{material.texture}")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        for wrap in ("wrapS", "wrapT"):
            texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
        scale = texture.CreateInput("scale", Sdf.ValueTypeNames.Float4)
        scale.Set(Gf.Vec4f(*(float(v) for v in linear), 1.0))
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        color.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    look.CreateSurfaceOutput().ConnectToSource(surface)
    return look


def _srgb_to_linear(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _visual(
    stage: Usd.Stage,
    visual: VisualMesh,
    looks: list[UsdShade.Material],
    materials: tuple[Material, ...],
    labels: tuple[str, ...],
) -> None:
    count = max(len(materials), 1)
    key = (visual.face_label.astype(np.int64) + 1) * count + visual.face_material
    for value in np.unique(key):
        mine = np.flatnonzero(key == value)
        label, material = int(value // count) - 1, int(value % count)
        word = labels[label] if label >= 0 else "unlabelled"
        path = f"/World/Visual/{_name(word, label + 1)}_{material:03d}"
        used, inverse = np.unique(visual.faces[mine], return_inverse=True)
        mesh = _mesh(stage, path, visual.vertices[used], inverse.reshape(-1, 3))
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        )
        uv = np.ascontiguousarray(visual.corner_uv[mine].reshape(-1, 2), dtype=np.float32)
        primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
        mesh.CreateDoubleSidedAttr(True)
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(looks[material])
        if label >= 0:
            _label(mesh.GetPrim(), word)


def _mesh(
    stage: Usd.Stage, path: str, points: NDArray[np.float32], faces: NDArray[np.int64]
) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = np.ascontiguousarray(points, dtype=np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    counts = np.full(len(faces), faces.shape[1], dtype=np.int32)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    flat = np.ascontiguousarray(faces.reshape(-1), dtype=np.int32)
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(flat))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.stack([low, high]).astype(np.float32)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent))
    return mesh


def _label(prim: Usd.Prim, word: str) -> None:
    UsdSemantics.LabelsAPI.Apply(prim, SEMANTICS).CreateLabelsAttr([word])


def _objects(stage: Usd.Stage, objects: tuple[LabeledObject, ...]) -> None:
    """Named objects as empty labelled frames with their bounds, for whoever looks for them."""
    UsdGeom.Scope.Define(stage, "/World/Objects")
    for k, obj in enumerate(objects):
        prim = UsdGeom.Xform.Define(stage, f"/World/Objects/{_name(obj.name, k)}").GetPrim()
        _label(prim, obj.category)
        for name, value in (("lower", obj.lower_m), ("upper", obj.upper_m)):
            attribute = prim.CreateAttribute(f"vlnpe:{name}", Sdf.ValueTypeNames.Double3)
            attribute.Set(Gf.Vec3d(*value))


def _collider(
    stage: Usd.Stage, path: str, points: NDArray[np.float64], faces: NDArray[np.int64], word: str
) -> None:
    mesh = _mesh(stage, path, points.astype(np.float32), faces)
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
    shape = UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim())
    # Static colliders are taken as the triangles they are, not as a convex hull.
    shape.CreateApproximationAttr(UsdPhysics.Tokens.none)
    _label(mesh.GetPrim(), word)


def _floor_mesh(floor: Floor) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Covered cells as quads with corner heights averaged from the cells around each corner."""
    columns = floor.grid.columns
    height = np.pad(floor.height_m.astype(np.float64), 1, mode="edge")
    corner = 0.25 * (height[:-1, :-1] + height[1:, :-1] + height[:-1, 1:] + height[1:, 1:])
    i, j = np.nonzero(floor.covered)
    width = columns + 1
    base = i * width + j
    quads = np.stack([base, base + 1, base + width + 1, base + width], axis=1)
    used, inverse = np.unique(quads, return_inverse=True)
    xy = floor.grid.center_of(np.stack([used // width, used % width], axis=1) - 0.5)
    points = np.column_stack([xy, corner.ravel()[used]]).astype(np.float64)
    return points, inverse.reshape(quads.shape).astype(np.int64)


def _box_mesh(obstacles: Obstacles) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    bits = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)]) * 2 - 1
    points = obstacles.center_m[:, None] + obstacles.half_m[:, None] * bits[None]
    faces = _BOX_QUADS[None] + 8 * np.arange(len(points))[:, None, None]
    return points.reshape(-1, 3), faces.reshape(-1, 4)


def _check(path: Path) -> None:
    """Reopen and look at what matters: default prim, units, indices in range."""
    stage = Usd.Stage.Open(str(path))
    if not stage or not stage.GetDefaultPrim():
        raise FileFormatError(path, "written stage has no default prim")
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.z:
        raise FileFormatError(path, "written stage is not z up")
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            points = len(mesh.GetPointsAttr().Get())
            indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get())
            if len(indices) and (indices.min() < 0 or indices.max() >= points):
                raise FileFormatError(path, f"{prim.GetPath()}: face index out of range")
