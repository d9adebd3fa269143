"""Validate a USD scene: topology, assets, colliders, and usd-core's validators.

The validators of usd-core look at metadata, schemas and bindings, but not at arrays: face indices
out of range, points that are not numbers, primvars of the wrong length pass them. So do faces
whose corners coincide, which physics engines refuse to cook.
"""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade, UsdUtils, UsdValidation

from ...formats.core.arrays import I64, Array

# Authored extents may be off by rounding of single precision.
EXTENT_TOLERANCE_M = 1e-4


def check_usd(path: Path) -> list[str]:
    """Return all problems of the scene in `path`, one line each; empty = valid.

    Checked are: the file opens; default prim, z up, metres; every texture and layer it names is
    relative, lies in its folder and exists; per mesh the counts, indices, points, primvars and
    extent; materials resolve; colliders are static meshes with triangles as their shape, and one
    is a floor; labels are not empty; and usd-core's validators find no error.
    """
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        return [f"does not open: {_line(error)}"]
    problems = [*_stage(stage), *_assets(path)]
    for prim in stage.Traverse():
        where = str(prim.GetPath())
        lines: list[str] = []
        if prim.IsA(UsdGeom.Mesh):
            lines += mesh_problems(UsdGeom.Mesh(prim))
            lines += _material(prim)
        if prim.HasAPI(UsdPhysics.CollisionAPI):
            lines += _collider(prim)
        lines += _labels(prim)
        problems += [f"{where}: {text}" for text in lines]
    return problems + _validators(stage)


def _stage(stage: Usd.Stage) -> Iterator[str]:
    if not stage.GetDefaultPrim():
        yield "no default prim"
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.z:
        yield f"up axis {UsdGeom.GetStageUpAxis(stage)}, expected Z"
    if UsdGeom.GetStageMetersPerUnit(stage) != 1.0:
        yield f"{UsdGeom.GetStageMetersPerUnit(stage)} m per unit, expected 1"
    floors = [
        prim
        for prim in stage.Traverse()
        if prim.HasAPI(UsdPhysics.CollisionAPI)
        and any(
            "floor" in (UsdSemantics.LabelsAPI(prim, taxonomy).GetLabelsAttr().Get() or ())
            for taxonomy in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim)
        )
    ]
    if not floors:
        yield "no collider is labelled as floor"


def _assets(path: Path) -> Iterator[str]:
    """Check that every file that the layer refers to lies beside it or below."""
    copy = Sdf.Layer.CreateAnonymous()
    copy.TransferContent(Sdf.Layer.FindOrOpen(str(path)))
    named: set[str] = set()

    def collect(name: str) -> str:
        named.add(name)
        return name

    UsdUtils.ModifyAssetPaths(copy, collect)
    root = path.resolve().parent
    for name in sorted(named - {""}):
        relative = PurePosixPath(name)
        if relative.is_absolute() or ":" in name or ".." in relative.parts:
            yield f"{name} is not a relative path below the scene's folder"
        elif not (root / name).is_file():
            yield f"{name} is missing"
        elif not (root / name).resolve().is_relative_to(root):
            yield f"{name} leads out of the scene's folder"


def mesh_problems(mesh: UsdGeom.Mesh) -> Iterator[str]:
    """Return the problems of a mesh's arrays, one line each."""
    points = np.asarray(mesh.GetPointsAttr().Get() or np.empty((0, 3)), dtype=np.float64)
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
    index = np.asarray(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
    points = points.reshape(-1, 3)
    if not len(points) or not len(counts):
        yield "mesh without points or faces"
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        yield f"point {bad} is not a number"
    if len(counts) and counts.min() < 3:
        yield f"face {int(counts.argmin())} has {counts.min()} corners"
    if counts.sum() != len(index):
        yield f"{len(index)} face indices, the counts say {counts.sum()}"
        return
    wrong = (index < 0) | (index >= len(points))
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        yield f"face index {index[first]} out of range, valid: 0 … {len(points) - 1}"
        return
    yield from _collapsed_faces(points, counts, index)
    yield from _extent(mesh, points)
    sizes = {
        UsdGeom.Tokens.constant: 1,
        UsdGeom.Tokens.uniform: len(counts),
        UsdGeom.Tokens.vertex: len(points),
        UsdGeom.Tokens.varying: len(points),
        UsdGeom.Tokens.faceVarying: len(index),
    }
    for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
        yield from _primvar(primvar, sizes[primvar.GetInterpolation()])


def _collapsed_faces(points: Array, counts: I64, index: I64) -> Iterator[str]:
    face = np.repeat(np.arange(len(counts)), counts)
    end = np.cumsum(counts)
    after = np.arange(1, len(index) + 1)
    after[end[counts > 0] - 1] = (end - counts)[counts > 0]
    same = (points[index] == points[index[after]]).all(axis=1)
    if same.any():
        yield f"{same.sum()} faces have coinciding corners, the first is {face[same][0]}"


def _extent(mesh: UsdGeom.Mesh, points: Array) -> Iterator[str]:
    extent = mesh.GetExtentAttr().Get()
    if not extent:
        yield "no extent"
        return
    low, high = np.asarray(extent, dtype=np.float64)
    if len(points) and np.isfinite(points).all():
        off = max(np.abs(points.min(axis=0) - low).max(), np.abs(points.max(axis=0) - high).max())
        if not off <= EXTENT_TOLERANCE_M:
            yield f"extent is off by {off:.4g} m"


def _primvar(primvar: UsdGeom.Primvar, size: int) -> Iterator[str]:
    name, values = primvar.GetPrimvarName(), primvar.Get()
    if isinstance(values, str) or not hasattr(values, "__len__"):
        return
    count = len(values)
    if primvar.IsIndexed():
        indices = np.asarray(primvar.GetIndices(), dtype=np.int64)
        if len(indices) and (indices.min() < 0 or indices.max() >= count):
            yield f"primvar {name}: index out of range, valid: 0 … {count - 1}"
        count = len(indices)
    if count != size * primvar.GetElementSize():
        kind = primvar.GetInterpolation()
        yield f"primvar {name} ({kind}) has {count} values, the mesh needs {size}"
    array = np.asarray(values)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        yield f"primvar {name} has values that are not numbers"


def _material(prim: Usd.Prim) -> Iterator[str]:
    api = UsdShade.MaterialBindingAPI(prim)
    for purpose in ("", "physics"):
        binding = api.GetDirectBinding(purpose)
        if binding.GetMaterialPath() and not binding.GetMaterial():
            yield f"material {binding.GetMaterialPath()} does not exist"


def _collider(prim: Usd.Prim) -> Iterator[str]:
    if not prim.IsA(UsdGeom.Gprim):
        yield "collision on something that has no surface"
    parent = prim
    while parent:
        if parent.HasAPI(UsdPhysics.RigidBodyAPI):
            yield f"collider moves with rigid body {parent.GetPath()}, expected: static"
        parent = parent.GetParent()
    if prim.IsA(UsdGeom.Mesh):
        shape = (
            UsdPhysics.MeshCollisionAPI(prim) if prim.HasAPI(UsdPhysics.MeshCollisionAPI) else None
        )
        kind = shape.GetApproximationAttr().Get() if shape else "not set"
        if kind != UsdPhysics.Tokens.none:
            yield f"collider's approximation is {kind}, expected none (its own triangles)"


def _labels(prim: Usd.Prim) -> Iterator[str]:
    for taxonomy in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim):
        words = UsdSemantics.LabelsAPI(prim, taxonomy).GetLabelsAttr().Get()
        if not words or not all(words):
            yield f"empty label in {taxonomy}"


def _validators(stage: Usd.Stage) -> list[str]:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [
        f"{error.GetName()}: {_line(error.GetMessage())}"
        for error in errors
        if error.GetType() == UsdValidation.ValidationErrorType.Error
    ]


def _line(text: object) -> str:
    return " ".join(str(text).split())
