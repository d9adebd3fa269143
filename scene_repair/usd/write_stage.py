"""Write the repaired scene as one USD file: materials, labelled objects, collision.

Layout, as read by Isaac Sim and others:

    /World                      default prim
      Looks, Friction           materials
      Objects/<name>            one prim per named thing, labelled; its meshes below, by material,
                                and Collision_<level>: the boxes that a robot can touch of it
      Unnamed/<label>           faces of no named thing
      Collision/Floor_<level>   what carries, facing up
      Collision/Boxes_<level>   what else is in the way

Colliders are meshes of their own: scanned surfaces are single sheets that face either way, while
physics engines such as PhysX let things pass through a triangle's back. There is no physics scene
in the file, because it is meant to be referenced into one, and simulators make one if there is
none. Labels are written twice: as UsdSemantics' `semantics:labels:class`, and as the attributes
`semantic:Semantics:params:*` that replicators before Isaac Sim 5 read.
"""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade

from ...formats.core.arrays import I64
from ...formats.core.errors import FileFormatError
from ...formats.scene.bundle import Floor, LabeledObject, Material, Obstacles, VisualMesh
from ..verify.usd import check_usd
from .write_geometry import box_surfaces, collider, floor_surface, visual_mesh
from .write_materials import friction, look

log = logging.getLogger(__name__)

TAXONOMY = "class"
# Prims cost milliseconds each; beyond this many, the smallest things get none of their own.
MAX_THINGS = 5000


@dataclass(frozen=True)
class UsdContent:
    """The content of the file, as in `SceneBundle`; `levels`: what carries, what is in the way.

    `facts` say where the scene comes from (source, sha256, licence, …) and are kept as layer data.
    """

    visual: VisualMesh
    materials: tuple[Material, ...]
    labels: tuple[str, ...]
    objects: tuple[LabeledObject, ...]
    levels: list[tuple[Floor, Obstacles]]
    facts: dict[str, Any]


def write_usd(path: Path, content: UsdContent) -> None:
    """Write `path` and check what was written; textures are referenced relative to it.

    Of more than `MAX_THINGS` objects those with most faces get prims; the rest stands under
    /World/Unnamed. A FileFormatError is raised if what was written does not hold.
    """
    content = _largest_things(content)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world.GetPrim()).SetKind(Kind.Tokens.assembly)
    stage.GetRootLayer().customLayerData = {"vlnpe": content.facts}
    names = _Names()
    UsdGeom.Scope.Define(stage, "/World/Looks")
    materials = [
        look(stage, f"/World/Looks/{names.of('/World/Looks', m.name)}", m)
        for m in content.materials
    ]
    visual = content.visual
    nameless = len(content.objects) + 1 + visual.face_label
    part = np.where(visual.face_object < 0, nameless, visual.face_object).astype(np.int64)
    paths = _parts(content, names, stage)
    _meshes(stage, visual, part, paths, materials)
    _collision(stage, content.levels, paths)
    stage.GetRootLayer().Save()
    problems = check_usd(path)
    if problems:
        raise FileFormatError(path, f"the written stage is invalid: {'; '.join(problems[:3])}")


def _largest_things(content: UsdContent) -> UsdContent:
    count, visual = len(content.objects), content.visual
    if count <= MAX_THINGS:
        return content
    log.warning("%d objects; the %d with most faces get prims", count, MAX_THINGS)
    faces = np.bincount(visual.face_object[visual.face_object >= 0], minlength=count)
    largest = np.sort(np.argsort(-faces, kind="stable")[:MAX_THINGS])
    number = np.full(count + 1, -1, dtype=np.int32)
    number[largest] = np.arange(MAX_THINGS)
    return replace(
        content,
        objects=tuple(content.objects[k] for k in largest),
        visual=replace(visual, face_object=number[visual.face_object]),
        levels=[
            (floor, replace(boxes, box_object=number[boxes.box_object]))
            for floor, boxes in content.levels
        ],
    )


class _Names:
    """Prim names that are valid and unique below each parent."""

    def __init__(self) -> None:
        self._taken: dict[str, set[str]] = {}

    def of(self, parent: str, text: str) -> str:
        """Return a name derived from `text` that is unique below `parent`."""
        taken = self._taken.setdefault(parent, set())
        name, n = Tf.MakeValidIdentifier(text or "unnamed"), 1
        unique = name
        while unique in taken:
            n += 1
            unique = f"{name}_{n}"
        taken.add(unique)
        return unique


def _parts(content: UsdContent, names: _Names, stage: Usd.Stage) -> list[str]:
    """Write a labelled prim per object, and one per label of unnamed faces.

    Their paths are returned: of the objects, of nameless faces without label, and of each label's.
    """
    paths = []
    _group(stage, "/World/Objects")
    for obj in content.objects:
        prim = _component(stage, "/World/Objects", obj.name, names)
        _label(prim, obj.category)
        for name, value in (("lower", obj.lower_m), ("upper", obj.upper_m)):
            attribute = prim.CreateAttribute(f"vlnpe:{name}", Sdf.ValueTypeNames.Double3)
            attribute.Set(Gf.Vec3d(*value))
        paths.append(str(prim.GetPath()))
    _group(stage, "/World/Unnamed")
    visual = content.visual
    left = set(np.unique(visual.face_label[visual.face_object < 0]).tolist())
    for label, word in enumerate(("unlabelled", *content.labels), start=-1):
        if label not in left:
            paths.append("")
            continue
        prim = _component(stage, "/World/Unnamed", word, names)
        if label >= 0:
            _label(prim, word)
        paths.append(str(prim.GetPath()))
    return paths


def _component(stage: Usd.Stage, parent: str, text: str, names: _Names) -> Usd.Prim:
    prim = UsdGeom.Xform.Define(stage, f"{parent}/{names.of(parent, text)}").GetPrim()
    Usd.ModelAPI(prim).SetKind(Kind.Tokens.component)
    prim.SetDisplayName(text)
    return prim


def _group(stage: Usd.Stage, path: str) -> None:
    prim = UsdGeom.Xform.Define(stage, path).GetPrim()
    Usd.ModelAPI(prim).SetKind(Kind.Tokens.group)


def _meshes(
    stage: Usd.Stage,
    visual: VisualMesh,
    part: I64,
    paths: list[str],
    materials: list[UsdShade.Material],
) -> None:
    """Write one mesh per part and material; omit degenerate faces."""
    key = part * max(len(materials), 1) + visual.face_material
    a, b, c = (visual.vertices[visual.faces[:, k]] for k in range(3))
    collapsed = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    key = np.where(collapsed, -1, key)
    order = np.argsort(key, kind="stable")
    values, starts = np.unique(key[order], return_index=True)
    for value, selected in zip(values, np.split(order, starts[1:]), strict=True):
        if value < 0:
            continue
        path, material = paths[value // len(materials)], int(value % len(materials))
        name = materials[material].GetPath().name
        used, inverse = np.unique(visual.faces[selected], return_inverse=True)
        visual_mesh(
            stage,
            f"{path}/{name}",
            visual.vertices[used],
            inverse.reshape(-1, 3).astype(np.int32),
            visual.corner_uv[selected],
            materials[material],
        )


def _collision(stage: Usd.Stage, levels: list[tuple[Floor, Obstacles]], paths: list[str]) -> None:
    """Write the floors, each object's boxes below it, and one prim for all other boxes."""
    grip = friction(stage, "/World/Friction")
    UsdGeom.Scope.Define(stage, "/World/Collision")
    for k, (floor, boxes) in enumerate(levels):
        prim = collider(stage, f"/World/Collision/Floor_{k}", *floor_surface(floor), grip)
        _label(prim, "floor")
        for thing in np.unique(boxes.box_object).tolist():
            selected = boxes.box_object == thing
            surfaces = box_surfaces(Obstacles(boxes.center_m[selected], boxes.half_m[selected]))
            if thing >= 0:
                collider(stage, f"{paths[thing]}/Collision_{k}", *surfaces, grip)
            else:
                prim = collider(stage, f"/World/Collision/Boxes_{k}", *surfaces, grip)
                _label(prim, "obstacle")


def _label(prim: Usd.Prim, word: str) -> None:
    UsdSemantics.LabelsAPI.Apply(prim, TAXONOMY).CreateLabelsAttr([word])
    prim.AddAppliedSchema("SemanticsAPI:Semantics")
    for name, value in (("Type", TAXONOMY), ("Data", word)):
        path = f"semantic:Semantics:params:semantic{name}"
        prim.CreateAttribute(path, Sdf.ValueTypeNames.String).Set(value)
