"""What a repair writes: the bundle, the USD stage, the pictures, the record."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from tests.support.scenes import scans
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.write.describe import repair_titles
from vlnpe.scene_repair.write.pictures import text_scale, write_picture
from vlnpe.wayfinding.distance import distance_field

QUICK = RepairConfig(picture_px=300)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room with a checkered floor, a hole in it, and named furniture."""
    folder = tmp_path_factory.mktemp("source")
    parts = {f"Wall_{k}": w for k, w in enumerate(scans.walls((0, 0), (5, 4)))}
    parts["Floor_1"] = scans.sheet((0, 0), (5, 4), without=scans.disc(3.5, 1.0, 0.4))
    parts["KitchenTable_1"] = scans.box((1, 1, 0), (2, 2, 0.75))
    parts["Carpet_1"] = scans.box((3, 2.5, 0), (4.5, 3.5, 0.015))
    (folder / "LICENSE.house").write_text("Use as you like.")
    return scans.write_named_glb(parts, folder / "house.glb")


@pytest.fixture(scope="module")
def bundle(source: Path, tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    out = tmp_path_factory.mktemp("bundle")
    lines: list[str] = []
    repair_scene(source, out, progress=lines.append)
    assert len(lines) >= 5
    return load_bundle(out)


@pytest.mark.parametrize(
    ("holes", "cracks", "patched_m2", "missing", "added"),
    [
        (1, 2, 0.5, "1 hole, 2 cracks, 0.50 m² of floor missing", "0.50 m² of floor added"),
        (0, 3, 0.004, "0 holes, 3 cracks: tiny gaps", "tiny gaps closed"),
        (0, 0, 0.0, "0 holes, 0 cracks, 0.00 m² of floor missing", "0.00 m² of floor added"),
    ],
)
def test_titles_of_the_pictures(
    holes: int, cracks: int, patched_m2: float, missing: str, added: str
) -> None:
    assert repair_titles(holes, cracks, patched_m2) == (missing, added)


def test_square_metres_in_a_title_are_drawn_raised_and_fit(tmp_path: Path) -> None:
    pixels = GridSpec((0.0, 0.0), 0.02, 20, 400)
    view = {"level 0": np.ones((20, 400, 3), np.float32)}
    drawn = {}
    for text in ("9 m", "9 m²", "9 m2"):
        scale = text_scale(pixels, text, [])
        write_picture(tmp_path / "t.png", view, pixels, text, [], scale=scale)
        image = cv2.imread(str(tmp_path / "t.png"), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        drawn[text] = image[:32] < 160  # the title's line
    plain = drawn["9 m"].any(axis=0).nonzero()[0][-1]
    ends = {text: ink.any(axis=0).nonzero()[0][-1] for text, ink in drawn.items()}
    assert plain < ends["9 m²"] < ends["9 m2"]  # smaller than the line's numbers
    rows = drawn["9 m²"][:, plain + 1 :].any(axis=1).nonzero()[0]
    line = drawn["9 m"].any(axis=1).nonzero()[0]
    assert rows[-1] < line[-1] - 2  # above the line on which the others stand


def test_bundle_is_whole(bundle: SceneBundle, source: Path) -> None:
    files = {str(p.relative_to(bundle.root)) for p in bundle.root.rglob("*") if p.is_file()}
    expected = {"scene.json", "scene.usdc", "visual.npz", "repair.json", "before.png", "after.png"}
    expected |= {f"levels/0/{n}.npz" for n in ("floor", "obstacles", "freemap")}
    assert expected <= files
    assert {f for f in files if f.startswith("textures/")} == {
        m.texture for m in bundle.materials if m.texture
    }
    assert bundle.scene_id == "house"
    assert bundle.source["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert bundle.source["licence"] == "Use as you like."
    assert bundle.source["path"] == "house.glb"
    assert bundle.level_floor_z_m == pytest.approx((0.0,), abs=1e-3)
    before, after = (cv2.imread(str(bundle.root / f"{name}.png")) for name in ("before", "after"))
    assert before is not None and after is not None and before.shape == after.shape


def test_arrays_agree(bundle: SceneBundle) -> None:
    visual = bundle.visual()
    count = len(visual.faces)
    assert visual.corner_uv.shape == (count, 3, 2)
    assert visual.face_material.shape == visual.face_label.shape == (count,)
    assert visual.faces.min() >= 0
    assert visual.faces.max() < len(visual.vertices)
    assert 0 <= visual.face_material.min() <= visual.face_material.max() < len(bundle.materials)
    assert -1 <= visual.face_label.min() <= visual.face_label.max() < len(bundle.labels)
    assert visual.face_object.shape == (count,) and visual.face_object.dtype == np.int32
    assert -1 <= visual.face_object.min() <= visual.face_object.max() < len(bundle.objects)
    assert np.isfinite(visual.corner_uv).all()
    floor, freemap = bundle.floor(0), bundle.freemap(0)
    assert floor.grid == freemap.grid
    assert np.isfinite(floor.height_m).all()
    assert np.array_equal(np.isfinite(freemap.floor_z_m), floor.covered)
    assert not (freemap.traversable & ~floor.covered).any()
    assert (bundle.obstacles(0).half_m > 0).all()


def test_labels_and_objects(bundle: SceneBundle) -> None:
    by_name = {o.name: o for o in bundle.objects}
    assert by_name["KitchenTable_1"].category == "kitchen table"
    assert by_name["KitchenTable_1"].upper_m == pytest.approx((2, 2, 0.75), abs=1e-5)
    assert {o.level for o in bundle.objects} == {0}
    assert {"floor", "carpet", "kitchen table", "wall"} <= set(bundle.labels)
    visual = bundle.visual()
    patch = next(k for k, m in enumerate(bundle.materials) if m.name == "floor_patch_0")
    labels = set(visual.face_label[visual.face_material == patch].tolist())
    assert labels == {bundle.labels.index("floor")}


def test_every_face_knows_its_object(bundle: SceneBundle) -> None:
    visual = bundle.visual()
    corners = visual.vertices[visual.faces]
    for k, thing in enumerate(bundle.objects):
        selected = corners[visual.face_object == k].reshape(-1, 3)
        assert len(selected), thing.name
        assert selected.min(axis=0) == pytest.approx(thing.lower_m, abs=1e-4)
        assert selected.max(axis=0) == pytest.approx(thing.upper_m, abs=1e-4)
    patch = next(k for k, m in enumerate(bundle.materials) if m.name == "floor_patch_0")
    assert set(visual.face_object[visual.face_material == patch].tolist()) == {-1}


def test_bundle_without_instances_still_opens(bundle: SceneBundle, tmp_path: Path) -> None:
    with np.load(bundle.root / "visual.npz") as data:
        arrays = {key: data[key] for key in data.files if key != "face_object"}
    np.savez(tmp_path / "visual.npz", **arrays)
    old = replace(bundle, root=tmp_path).visual()
    assert np.array_equal(old.face_object, np.full(len(old.faces), -1))
    del arrays["faces"]
    np.savez(tmp_path / "visual.npz", **arrays)
    with pytest.raises(FileFormatError, match=r"visual\.npz"):
        replace(bundle, root=tmp_path).visual()


def test_repair_record(bundle: SceneBundle) -> None:
    record = json.loads((bundle.root / "repair.json").read_text())
    level = record["levels"][0]
    filled = [h for h in level["holes"] if h["action"] == "filled"]
    assert len(filled) == 1
    assert filled[0]["area_m2"] == pytest.approx(np.pi * 0.16, rel=0.1)
    assert np.mean(filled[0]["polygons_xy_m"][0], axis=0) == pytest.approx((3.5, 1.0), abs=0.05)
    assert filled[0]["cause"] and filled[0]["reason"]
    grown = level["floor_area_after_m2"] - level["floor_area_before_m2"]
    assert grown == pytest.approx(level["patched_area_m2"], abs=0.01)
    assert level["probes"]["fell_through"] == 0
    assert record["source"]["up"] == "y"


@pytest.mark.parametrize("name", ["before", "after"])
def test_pictures(bundle: SceneBundle, name: str) -> None:
    image = Image.open(bundle.root / f"{name}.png")
    assert image.width >= 900
    pixels = np.asarray(image.convert("RGB")).astype(int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 110) & (pixels[..., 2] < 110)
    green = (pixels[..., 1] > 120) & (pixels[..., 0] < 60) & (pixels[..., 2] < 90)
    marked = red if name == "before" else green
    assert marked.sum() > 300
    assert np.std(pixels) > 20


def test_usd_reopens_with_collision_and_labels(bundle: SceneBundle) -> None:
    from pxr import Usd, UsdGeom, UsdPhysics, UsdSemantics, UsdShade

    stage = Usd.Stage.Open(str(bundle.root / "scene.usdc"))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    colliders = [p for p in stage.Traverse() if p.HasAPI(UsdPhysics.CollisionAPI)]
    paths = {str(p.GetPath()) for p in colliders}
    assert "/World/Collision/Floor_0" in paths
    assert "/World/Objects/KitchenTable_1/Collision_0" in paths
    assert {f"/World/Objects/Wall_{k}/Collision_0" for k in range(4)} <= paths
    assert all(UsdGeom.Imageable(p).GetPurposeAttr().Get() == "guide" for p in colliders)
    triangles, textures, words = 0, set(), set()
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh) and prim not in colliders:
            mesh = UsdGeom.Mesh(prim)
            triangles += len(mesh.GetFaceVertexCountsAttr().Get())
            uv = UsdGeom.PrimvarsAPI(prim).GetPrimvar("st").Get()
            assert len(uv) == len(mesh.GetFaceVertexIndicesAttr().Get())
            assert UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0]
            words |= set(UsdSemantics.LabelsAPI(prim.GetParent(), "class").GetLabelsAttr().Get())
            assert not prim.HasAPI(UsdPhysics.CollisionAPI)
        if prim.IsA(UsdShade.Shader):
            value = UsdShade.Shader(prim).GetInput("file")
            if value and value.Get():
                textures.add(value.Get().path)
    assert triangles == len(bundle.visual().faces)
    assert {"floor", "kitchen table", "wall"} <= words
    assert textures
    assert all(t.startswith("./") and (bundle.root / t).is_file() for t in textures)
    boxes = [p for p in colliders if p.GetName() in ("Boxes_0", "Collision_0")]
    corners = sum(len(UsdGeom.Mesh(p).GetPointsAttr().Get()) for p in boxes)
    assert corners == 8 * len(bundle.obstacles(0).center_m)


def test_usd_boxes_face_outwards(bundle: SceneBundle) -> None:
    import trimesh
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(bundle.root / "scene.usdc"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/Objects/KitchenTable_1/Collision_0")
    points = np.asarray(mesh.GetPointsAttr().Get())[:8]
    quads = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)[:6]
    first = trimesh.Trimesh(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    assert first.is_watertight
    obstacles = bundle.obstacles(0)
    table = [o.name for o in bundle.objects].index("KitchenTable_1")
    half = obstacles.half_m[obstacles.box_object == table][0]
    assert first.volume == pytest.approx(float(np.prod(2 * half)), rel=1e-4)


def test_usd_has_a_labelled_prim_per_thing(bundle: SceneBundle) -> None:
    """Instances for Isaac Sim: new and old semantics, and the faces that the bundle says."""
    from pxr import Usd, UsdGeom, UsdSemantics

    stage = Usd.Stage.Open(str(bundle.root / "scene.usdc"))
    visual = bundle.visual()
    for k, thing in enumerate(bundle.objects):
        prim = stage.GetPrimAtPath(f"/World/Objects/{thing.name}")
        assert list(UsdSemantics.LabelsAPI(prim, "class").GetLabelsAttr().Get()) == [thing.category]
        assert "SemanticsAPI:Semantics" in prim.GetMetadata("apiSchemas").GetAppliedItems()
        assert prim.GetAttribute("semantic:Semantics:params:semanticType").Get() == "class"
        assert prim.GetAttribute("semantic:Semantics:params:semanticData").Get() == thing.category
        meshes = [UsdGeom.Mesh(p) for p in prim.GetChildren() if p.GetName() != "Collision_0"]
        faces = sum(len(m.GetFaceVertexCountsAttr().Get()) for m in meshes)
        assert faces == (visual.face_object == k).sum() > 0
    box = UsdGeom.BBoxCache(0, ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World/Objects"))
    assert box.GetRange().GetMax()[2] == pytest.approx(2.6, abs=1e-4)


def test_source_travels_along(bundle: SceneBundle, source: Path) -> None:
    from pxr import Sdf

    digest = hashlib.sha256(source.read_bytes()).hexdigest()
    layer = Sdf.Layer.FindOrOpen(str(bundle.root / "scene.usdc"))
    record = json.loads((bundle.root / "repair.json").read_text())
    for facts in (layer.customLayerData["vlnpe"], record["source"], bundle.source):
        assert facts["path"] == "house.glb"
        assert facts["sha256"] == digest
        assert facts["licence"] == "Use as you like."


@pytest.mark.chain
def test_large_textures_are_scaled(source: Path, tmp_path: Path) -> None:
    bundle = repair_scene(
        source, tmp_path, RepairConfig(scene_id="small", max_texture_px=64, picture_px=200)
    )
    assert bundle.scene_id == "small"
    for material in bundle.materials:
        if material.texture:
            assert max(Image.open(bundle.root / material.texture).size) <= 64


@pytest.mark.chain
def test_small_house(shared_scenes: Path, tmp_path: Path) -> None:
    bundle = repair_scene(shared_scenes / "small_house.glb", tmp_path, QUICK)
    assert len(bundle.obstacles(0).center_m) < 3000
    freemap = bundle.freemap(0)
    rooms = {"bedroom": (-4.5, 0.0), "living": (3.0, 1.0), "kitchen": (8.0, -3.5), "gym": (0, 3)}
    for radius in (0.25, 0.30):
        field = distance_field(freemap, rooms["bedroom"], radius_m=radius)
        assert all(np.isfinite(field.at(xy)) for xy in rooms.values())
    # Everywhere a disc of 0.3 m fits it can also get to, nooks of a square foot apart.
    labelled: Any = ndimage.label(freemap.free(0.30), np.ones((3, 3)))
    parts, count = labelled
    area = np.bincount(parts.ravel())[1:] * freemap.grid.cell_m**2
    assert count and area.max() > 100
    assert area.sum() - area.max() < 0.1
    assert {"sofa", "bed", "kitchen table", "carpet"} <= set(bundle.labels)


@pytest.mark.chain
@pytest.mark.parametrize("name", ["quest_living_room", "quest_music_room", "quest_office_small"])
def test_headset_rooms(name: str, shared_scenes: Path, tmp_path: Path) -> None:
    bundle = repair_scene(shared_scenes / f"{name}.glb", tmp_path, QUICK)
    level = json.loads((tmp_path / "repair.json").read_text())["levels"][0]
    floor = next(o for o in bundle.objects if o.category == "floor")
    assert bundle.level_floor_z_m[0] == pytest.approx(
        (floor.lower_m[2] + floor.upper_m[2]) / 2, abs=0.08
    )
    size = np.subtract(floor.upper_m, floor.lower_m)
    # Rooms are not quite rectangular and stand askew in their box.
    assert 0.6 < level["floor_area_after_m2"] / (size[0] * size[1]) < 1.05
    assert level["floor_area_after_m2"] > level["floor_area_before_m2"]
    freemap = bundle.freemap(0)
    assert freemap.traversable.sum() * freemap.grid.cell_m**2 > 1.5
    # The scans are light grey; where a patch's texture was not painted it is black.
    number = [m.name for m in bundle.materials].index("floor_patch_0")
    texture = bundle.materials[number].texture
    assert texture is not None
    image = np.asarray(Image.open(tmp_path / texture).convert("L"))
    visual = bundle.visual()
    corners = visual.corner_uv[visual.face_material == number]
    weights = np.random.default_rng(0).dirichlet(np.ones(3), size=(len(corners), 20))
    u, v = np.moveaxis(weights @ corners, -1, 0)
    rows, columns = ((1 - v) * image.shape[0]).astype(int), (u * image.shape[1]).astype(int)
    assert image[rows.clip(0, len(image) - 1), columns.clip(0, image.shape[1] - 1)].min() > 50


@pytest.mark.chain
def test_laser_scan_without_axis_or_labels(shared_scenes: Path, tmp_path: Path) -> None:
    bundle = repair_scene(shared_scenes / "room_scan1.ply", tmp_path, QUICK)
    assert bundle.source["up"] in ("z", "-z")
    assert bundle.source["unit"] == "m"
    assert len(bundle.level_floor_z_m) == 1
    floor = bundle.floor(0)
    assert 45 < floor.covered.sum() * floor.grid.cell_m**2 < 80
    record = json.loads((tmp_path / "repair.json").read_text())
    level = record["levels"][0]
    added, scanned = level["patched_area_m2"], level["floor_area_before_m2"]
    told = [doubt for doubt in record["doubts"] if "more floor was added" in doubt]
    assert added > scanned and len(told) == 1 and f"{added:.1f} m²" in told[0]
