"""The check of written USD scenes names what usd-core's own validators do not see."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation, Vt

from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.bundle import Floor, LabeledObject, Material, Obstacles, VisualMesh
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.usd.write_stage import UsdContent, write_usd
from vlnpe.scene_repair.verify.usd import check_usd

CRATE = "/World/Objects/Crate_1"
FLOOR = "/World/Collision/Floor_0"


def content(**changes: Any) -> UsdContent:
    """Two triangles of a crate with two materials, and one triangle of no named thing."""
    visual = VisualMesh(
        vertices=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1]], np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4]], np.int32),
        corner_uv=np.zeros((3, 3, 2), np.float32),
        face_material=np.array([0, 1, 0], np.int32),
        face_label=np.array([0, 0, -1], np.int32),
        face_object=np.array([0, 0, -1], np.int32),
    )
    grid = GridSpec((0.0, 0.0), 0.05, 8, 8)
    floor = Floor(grid, np.zeros(grid.shape, np.float32), np.eye(8, dtype=bool))
    boxes = Obstacles(np.full((2, 3), 0.5), np.full((2, 3), 0.1), np.array([0, -1], np.int32))
    parts: dict[str, Any] = {
        "visual": visual,
        "materials": (Material("red paint", texture="textures/red.png"), Material("red_paint")),
        "labels": ("crate",),
        "objects": (
            LabeledObject("Crate_1", "crate", (0, 0, 0), (1, 1, 1), 0),
            LabeledObject("Crate 1", "crate", (0, 0, 0), (1, 1, 1), 0),
        ),
        "levels": [(floor, boxes)],
        "facts": {"path": "x.glb", "sha256": "0" * 64, "licence": ""},
    }
    return UsdContent(**(parts | changes))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures" / "red.png").write_bytes(b"any")
    return tmp_path / "scene.usdc"


@pytest.fixture
def written(path: Path) -> Path:
    write_usd(path, content())
    return path


def test_a_sound_scene_has_no_problems(written: Path) -> None:
    assert check_usd(written) == []


def test_names_that_look_alike_stay_apart(written: Path) -> None:
    stage = Usd.Stage.Open(str(written))
    assert stage.GetPrimAtPath("/World/Objects/Crate_1_2").GetDisplayName() == "Crate 1"
    assert stage.GetPrimAtPath("/World/Looks/red_paint_2")


def test_too_many_things_share_a_prim(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vlnpe.scene_repair.usd.write_stage.MAX_THINGS", 1)
    whole = content()
    visual = replace(whole.visual, face_object=np.array([1, 1, 0], np.int32))
    write_usd(path, content(visual=visual))
    stage = Usd.Stage.Open(str(path))
    things = stage.GetPrimAtPath("/World/Objects").GetChildren()
    assert [t.GetDisplayName() for t in things] == ["Crate 1"]
    assert stage.GetPrimAtPath("/World/Unnamed/unlabelled/red_paint")
    assert stage.GetPrimAtPath("/World/Collision/Boxes_0")


def test_faces_without_extent_are_left_out(path: Path) -> None:
    visual = content().visual
    visual.vertices[2] = visual.vertices[1]
    write_usd(path, content(visual=visual))
    stage = Usd.Stage.Open(str(path))
    assert not stage.GetPrimAtPath(f"{CRATE}/red_paint")
    assert stage.GetPrimAtPath(f"{CRATE}/red_paint_2")


def test_an_invalid_stage_is_not_written_silently(path: Path) -> None:
    visual = content().visual
    visual.vertices[4, 2] = np.nan
    with pytest.raises(FileFormatError, match="point"):
        write_usd(path, content(visual=visual))


def mesh(stage: Usd.Stage) -> UsdGeom.Mesh:
    return UsdGeom.Mesh.Get(stage, f"{CRATE}/red_paint")


def primvar(stage: Usd.Stage) -> UsdGeom.Primvar:
    return UsdGeom.PrimvarsAPI(mesh(stage)).GetPrimvar("st")


def indexed(stage: Usd.Stage) -> None:
    primvar(stage).SetIndices(Vt.IntArray([0, 1, 3]))


def move(stage: Usd.Stage) -> None:
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath("/World/Collision"))


def texture_to(name: str) -> Callable[[Usd.Stage], object]:
    path = "/World/Looks/red_paint/Texture"
    return lambda s: UsdShade.Shader.Get(s, path).GetInput("file").Set(Sdf.AssetPath(name))


def indices_to(*values: int) -> Callable[[Usd.Stage], object]:
    return lambda stage: mesh(stage).GetFaceVertexIndicesAttr().Set(Vt.IntArray(values))


def counts_to(*values: int) -> Callable[[Usd.Stage], object]:
    return lambda stage: mesh(stage).GetFaceVertexCountsAttr().Set(Vt.IntArray(values))


def points_to(*value: tuple[float, float, float]) -> Callable[[Usd.Stage], object]:
    return lambda stage: mesh(stage).GetPointsAttr().Set(Vt.Vec3fArray(value))


def coordinates_to(value: Any) -> Callable[[Usd.Stage], object]:
    return lambda stage: primvar(stage).Set(Vt.Vec2fArray(value))


def hull(stage: Usd.Stage) -> None:
    UsdPhysics.MeshCollisionAPI.Get(stage, FLOOR).GetApproximationAttr().Set("convexHull")


def unlabel(stage: Usd.Stage) -> None:
    stage.GetPrimAtPath(CRATE).GetAttribute("semantics:labels:class").Set([])


BREAKS: dict[str, tuple[Callable[[Usd.Stage], object], str]] = {
    "index too large": (indices_to(0, 1, 3), "face index 3 out of range"),
    "index negative": (indices_to(0, -1, 2), "face index -1 out of range"),
    "indices too few": (indices_to(0, 1), "2 face indices, the counts say 3"),
    "a face of two corners": (counts_to(2), "face 0 has 2 corners"),
    "no faces": (counts_to(), "without points or faces"),
    "not a number": (points_to((0, 0, 0), (1, 0, 0), (np.nan, 1, 0)), "point 2 is not a number"),
    "infinite": (points_to((0, np.inf, 0), (1, 0, 0), (0, 1, 0)), "point 0 is not a number"),
    "a corner named twice": (indices_to(0, 1, 1), "coinciding corners, the first is 0"),
    "corners in one place": (points_to((0, 0, 0), (1, 1, 0), (0, 0, 0)), "coinciding corners, the"),
    "extent": (points_to((0, 0, 0), (1, 0, 0), (1, 1.5, 0)), "extent is off by 0.5 m"),
    "texture coordinates": (coordinates_to(2), "st (faceVarying) has 2 values, the mesh needs 3"),
    "a coordinate that is no number": (
        coordinates_to([(0, 0), (0, np.nan), (0, 0)]),
        "primvar st has values that are not numbers",
    ),
    "primvar index": (indexed, "primvar st: index out of range, valid: 0 … 2"),
    "up axis": (lambda s: UsdGeom.SetStageUpAxis(s, "Y"), "up axis Y"),
    "unit": (lambda s: UsdGeom.SetStageMetersPerUnit(s, 0.01), "0.01 m per unit"),
    "default prim": (lambda s: s.ClearDefaultPrim(), "no default prim"),
    "convex hull": (hull, "approximation is convexHull"),
    "moving collider": (move, "moves with rigid body /World/Collision"),
    "no floor": (lambda s: s.RemovePrim(FLOOR), "no collider is labelled as floor"),
    "empty label": (unlabel, "empty label in class"),
    "material": (lambda s: s.RemovePrim("/World/Looks/red_paint"), "does not exist"),
    "texture missing": (texture_to("./textures/blue.png"), "blue.png is missing"),
    "texture above": (texture_to("../red.png"), "not a relative path"),
    "texture absolute": (texture_to("/etc/red.png"), "not a relative path"),
    "texture elsewhere": (texture_to("https://a.b/red.png"), "not a relative path"),
    "nested": (lambda s: UsdGeom.Cube.Define(s, f"{CRATE}/red_paint/In"), "InvalidNestedGprims"),
}


@pytest.mark.parametrize("name", BREAKS)
def test_broken_stages_are_named(name: str, written: Path) -> None:
    spoil, message = BREAKS[name]
    stage = Usd.Stage.Open(str(written))
    spoil(stage)
    stage.GetRootLayer().Save()
    del stage
    problems = check_usd(written)
    assert any(message in p for p in problems), problems


def test_validators_alone_would_miss_it(written: Path) -> None:
    """The reason for the check: an index out of range passes all of usd-core's validators."""
    stage = Usd.Stage.Open(str(written))
    mesh(stage).GetFaceVertexIndicesAttr().Set(Vt.IntArray([0, 1, 99]))
    registry = UsdValidation.ValidationRegistry()
    context = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators())
    kinds = [e.GetType() for e in context.Validate(stage)]
    assert UsdValidation.ValidationErrorType.Error not in kinds


@pytest.mark.parametrize("size", [0, 100, -50])
def test_damaged_file_is_a_problem(written: Path, size: int) -> None:
    data = written.read_bytes()
    damaged = written.with_name("damaged.usdc")
    damaged.write_bytes(data[:size])
    assert check_usd(damaged)
