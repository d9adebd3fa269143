"""Read USD stages into parts; runs in a child process, see `sandbox`."""

import re
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from ...formats.core.arrays import Array
from ...formats.core.errors import FileFormatError
from ..config import UNIT_M
from ..scan.readings import Readings
from .layers import brief, check_layers
from .read_geometry import PartList, add_gprim
from .read_materials import StageMaterials

# What instancing may blow a file up to.
MAX_PRIMS, MAX_DEPTH = 3_000_000, 200
NUREC, NUREC_KIND = "omni:nurec:isNuRecVolume", "NuRec volume of 3DGRUT"
AS_SCENE = "they are read where the file is given as a scan, not as --collision"
TIME = Usd.TimeCode.EarliestTime()


def read(path: Path) -> Readings:
    """Read all that is visible at its earliest time; raise FileFormatError if damaged."""
    warnings = check_layers(path)
    stage = open_stage(path, warnings)
    parts = PartList(path, StageMaterials(path.parent.resolve(), warnings), warnings)
    try:
        _walk(stage.GetPseudoRoot(), np.eye(4), "", parts, UsdGeom.XformCache(TIME), 0)
        up, unit = _conventions(stage, warnings)
    # Values of other types than their names promise fail in many ways.
    except (Tf.ErrorException, TypeError, ValueError, AttributeError, IndexError) as error:
        raise FileFormatError(path, f"damaged: {brief(error)}") from error
    if splats := _splats(stage):
        if not parts.parts:
            raise FileFormatError(path, f"holds Gaussian splats ({splats}) and no mesh; {AS_SCENE}")
        warnings.append(f"Gaussian splats ({splats}) beside the meshes left out; {AS_SCENE}")
    return Readings(parts.parts, up, unit, warnings)


def _splats(stage: Usd.Stage) -> str:
    """Return how the stage holds Gaussian splats; empty if it holds none."""
    return next((kind for prim in stage.Traverse() if (kind := splats_in(prim))), "")


def splats_in(prim: Usd.Prim) -> str:
    """Return how a prim holds Gaussian splats; empty if it holds none.

    3DGRUT writes volumes with a `.nurec` file, or prims of USD's particle field schemas.
    """
    kind = str(prim.GetTypeName())
    if kind.startswith("ParticleField"):
        return kind
    return NUREC_KIND if kind == "Volume" and prim.GetAttribute(NUREC).IsValid() else ""


def open_stage(path: Path, warnings: list[str]) -> Usd.Stage:
    """Return the composed stage, missing layers in `warnings`; raise FileFormatError if damaged."""
    try:
        stage = Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(path.resolve())), Usd.Stage.LoadAll)
        problems = stage.GetCompositionErrors() if stage else []
    except Exception as error:
        raise FileFormatError(path, f"cannot be composed: {brief(error)}") from error
    if not stage:
        raise FileFormatError(path, "cannot be composed")
    for problem in problems:
        # Layers without a file are named by their place in memory, which differs in each run.
        text = re.sub(r"anon:0x[0-9a-f]+(:[^\s@]*)?", "anonymous", " ".join(str(problem).split()))
        if "cycle" in type(problem).__name__.lower() or "cycle" in str(problem.errorType).lower():
            raise FileFormatError(path, f"circular references: {text[:300]}")
        warnings.append(f"composition: {text[:200]}")
    return stage


def _conventions(
    stage: Usd.Stage, warnings: list[str]
) -> tuple[tuple[str, str] | None, tuple[str, str] | None]:
    """Return up axis and unit if the stage states them."""
    up = unit = None
    if stage.HasAuthoredMetadata(UsdGeom.Tokens.upAxis):
        axis = str(UsdGeom.GetStageUpAxis(stage)).lower()
        up = (axis, f"the stage's upAxis is {axis.upper()}")
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit):
        return up, unit
    metres = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not np.isfinite(metres) or metres <= 0:
        warnings.append(f"metersPerUnit {metres} ignored")
        return up, unit
    reason = f"the stage's metersPerUnit is {metres:g}"
    names = (name for name, length in UNIT_M.items() if abs(metres / length - 1.0) < 1e-6)
    return up, (next(names, repr(metres)), reason)


def _walk(
    prim: Usd.Prim, outer: Array, name: str, parts: PartList, xforms: UsdGeom.XformCache, depth: int
) -> None:
    """Add everything visible below `prim`, which lies `depth` instancers deep, to `parts`.

    `outer` (4, 4) is a row-vector transform applied after the prims' own; `name` is the instance's.
    """
    if depth > MAX_DEPTH:
        raise FileFormatError(parts.path, "point instancers nested too deeply")
    predicate = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    walk = iter(Usd.PrimRange(prim, predicate))
    for at in walk:
        parts.prims += 1
        if parts.prims > MAX_PRIMS:
            raise FileFormatError(parts.path, f"contains more than {MAX_PRIMS:,} prims")
        if _hidden(at):
            walk.PruneChildren()
        elif at.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
            _instances(UsdGeom.PointInstancer(at), outer, name, parts, xforms, depth)
        elif at.IsA(UsdGeom.Gprim):
            local = np.array(xforms.GetLocalToWorldTransform(at))
            add_gprim(UsdGeom.Gprim(at), local @ outer, name, parts)


def _hidden(prim: Usd.Prim) -> bool:
    imageable = UsdGeom.Imageable(prim)
    if not imageable:
        return False
    if imageable.GetVisibilityAttr().Get(TIME) == UsdGeom.Tokens.invisible:
        return True
    purpose = imageable.GetPurposeAttr()
    return purpose.HasAuthoredValue() and purpose.Get() in (
        UsdGeom.Tokens.guide,
        UsdGeom.Tokens.proxy,
    )


def _instances(
    instancer: UsdGeom.PointInstancer,
    outer: Array,
    name: str,
    parts: PartList,
    xforms: UsdGeom.XformCache,
    depth: int,
) -> None:
    prim = instancer.GetPrim()
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    which = np.array(instancer.GetProtoIndicesAttr().Get(TIME) or [], dtype=np.int64)
    # Without the prototypes' own transforms: the walk below brings them.
    placed = instancer.ComputeInstanceTransformsAtTime(
        TIME, TIME, UsdGeom.PointInstancer.ExcludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
    )
    mask = instancer.ComputeMaskAtTime(TIME)
    if placed is None or len(placed) != len(which):
        parts.warn(f"{prim.GetPath()}: as many positions as indices are needed; skipped")
        return
    own = np.array(xforms.GetLocalToWorldTransform(prim))
    stage = prim.GetStage()
    for k, index in enumerate(which):
        if len(mask) and not mask[k]:
            continue
        if not 0 <= index < len(targets):
            parts.warn(f"{prim.GetPath()}: prototype index {index} is out of range; skipped")
            continue
        prototype = stage.GetPrimAtPath(targets[index])
        if not prototype:
            parts.warn(f"{prim.GetPath()}: prototype {targets[index]} is missing; skipped")
            continue
        # A prototype keeps its own transform, but not those above it.
        above = np.array(xforms.GetParentToWorldTransform(prototype))
        if abs(np.linalg.det(above)) < 1e-300:
            parts.warn(f"{targets[index]}: its place cannot be undone; skipped")
            continue
        moved = np.linalg.inv(above) @ np.array(placed[k]) @ own @ outer
        _walk(prototype, moved, f"{name or prim.GetPath()}[{k}]", parts, xforms, depth + 1)
