"""Reading USD: composition, visibility, names, colours."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSemantics, UsdShade, UsdUtils

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from tests.support.scenes.usd_stages import (
    SQUARE,
    bind,
    home,
    new_stage,
    preview,
    read_here,
    save,
    square,
)
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.usd.shapes import simple_shape


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_referenced_models_are_placed_named_and_textured(suffix: str, tmp_path: Path) -> None:
    scan = read_scan(home(tmp_path, suffix))
    assert scan.up is not None
    assert scan.unit is not None
    assert (scan.up[0], scan.unit[0]) == ("z", "cm")
    assert len(scan.faces) == 6
    beds = [k for k, o in enumerate(scan.objects) if o.category == "bed"]
    folder = "/Root/Meshes/Furnitures/bed/model_6f12ab34cd56ef78"
    assert {scan.objects[k].name for k in beds} == {f"{folder}_0", f"{folder}_1"}
    assert any(o.category == "floor" for o in scan.objects)
    for k, x in zip(beds, (0.0, 300.0), strict=True):
        faces = scan.face_object == k
        place = scan.vertices[scan.faces[faces]].reshape(-1, 3)
        assert place.min(axis=0) == pytest.approx((x, 0, 50))
        assert place.max(axis=0) == pytest.approx((x + 200, 200, 50))
        image = scan.materials[scan.face_material[faces][0]].image
        assert image is not None
        assert np.asarray(image)[0, 0].tolist() == [10, 200, 30]
        # The texture's corners lie at the square's corners.
        assert np.allclose(
            scan.corner_uv[faces].reshape(-1, 2), (place[:, :2] - (x, 0)) / 200, atol=1e-6
        )


def test_package_reads_as_the_loose_files(tmp_path: Path) -> None:
    loose = home(tmp_path / "loose", "usdc")
    package = tmp_path / "scene.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(loose)), str(package))
    there, here = read_here(loose), read_here(package)
    assert np.array_equal(there.vertices, here.vertices)
    assert np.array_equal(there.faces, here.faces)
    assert {o.category for o in here.objects} == {"bed", "floor"}
    images = [m.image for m in here.materials if m.image is not None]
    assert [np.asarray(i)[0, 0].tolist() for i in images] == [[10, 200, 30]]


def test_point_instancer_places_its_prototypes(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    instancer = UsdGeom.PointInstancer.Define(stage, "/Root/Chairs")
    UsdGeom.XformCommonAPI(instancer.GetPrim()).SetTranslate((10, 0, 0))
    UsdGeom.Xform.Define(stage, "/Root/Chairs/Prototypes/chair")
    square(stage, "/Root/Chairs/Prototypes/chair/mesh_0")
    UsdGeom.XformCommonAPI(stage.GetPrimAtPath("/Root/Chairs/Prototypes/chair")).SetTranslate(
        (0, 0, 5)
    )
    instancer.CreatePrototypesRel().AddTarget("/Root/Chairs/Prototypes/chair")
    instancer.CreateProtoIndicesAttr([0, 0, 0, 7])
    instancer.CreatePositionsAttr([(0, 0, 0), (0, 4, 0), (0, 8, 0), (0, 12, 0)])
    turn = Gf.Quath(np.sqrt(0.5), 0, 0, np.sqrt(0.5))
    instancer.CreateOrientationsAttr([Gf.Quath(1), turn, Gf.Quath(1), Gf.Quath(1)])
    instancer.CreateScalesAttr([(1, 1, 1), (1, 1, 1), (2, 2, 2), (1, 1, 1)])
    instancer.InvisId(0, Usd.TimeCode.Default())
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert [o.category for o in scan.objects] == ["chair", "chair"]
    bounds = [
        np.stack([p.min(axis=0), p.max(axis=0)])
        for p in (scan.vertices[scan.faces[scan.face_object == k]].reshape(-1, 3) for k in range(2))
    ]
    # A quarter turn takes the square 0…2 to x −2…0; twice the size also lifts it twice as high.
    assert bounds[0] == pytest.approx(np.array([(8, 4, 5), (10, 6, 5)]), abs=1e-2)
    assert bounds[1] == pytest.approx(np.array([(10, 8, 10), (14, 12, 10)]), abs=1e-5)
    assert any("prototype index 7" in w for w in scan.warnings)


def test_invisible_prims_are_left_out(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/floor")
    square(stage, "/Root/guide").CreatePurposeAttr(UsdGeom.Tokens.guide)
    square(stage, "/Root/Proxies/box")
    UsdGeom.Imageable(stage.DefinePrim("/Root/Proxies", "Xform")).CreatePurposeAttr("proxy")
    square(stage, "/Root/Hidden/box")
    UsdGeom.Imageable(stage.DefinePrim("/Root/Hidden", "Xform")).MakeInvisible()
    inactive = square(stage, "/Root/inactive")
    inactive.GetPrim().SetActive(False)
    stage.CreateClassPrim("/model")
    square(stage, "/model/box")
    save(stage)
    assert len(read_here(tmp_path / "scene.usda").faces) == 2


def test_orientation_mirrors_and_polygons(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    # A concave arrow head of five corners, and one of four.
    for name, outline in {
        "five": [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)],
        "four": [(0, 0), (2, 1), (4, 0), (2, 4)],
    }.items():
        mesh = UsdGeom.Mesh.Define(stage, f"/Root/{name}")
        mesh.CreatePointsAttr([(x, y, 0) for x, y in outline])
        mesh.CreateFaceVertexCountsAttr([len(outline)])
        mesh.CreateFaceVertexIndicesAttr(list(range(len(outline))))
    left = square(stage, "/Root/left")
    left.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    mirrored = square(stage, "/Root/mirrored")
    UsdGeom.XformCommonAPI(mirrored.GetPrim()).SetScale((-1, 1, 1))
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    a, b, c = (scan.vertices[scan.faces[:, k]] for k in range(3))
    up = np.cross(b - a, c - a)[:, 2] / 2
    # Areas by the shoelace formula. What a mirror turns over is turned back; the left-handed
    # square looks down.
    assert up[up > 0].sum() == pytest.approx(10.0 + 6.0 + 4.0)
    assert up[up < 0].sum() == pytest.approx(-4.0)


@pytest.mark.parametrize("interpolation", ["constant", "uniform", "vertex", "faceVarying"])
def test_colours_and_coordinates_of_every_interpolation(interpolation: str, tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/Root/board")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 1, 4, 5, 2])
    count = {"constant": 1, "uniform": 2, "vertex": 6, "faceVarying": 8}[interpolation]
    values = np.linspace(0.1, 0.9, count)
    mesh.CreateDisplayColorPrimvar(interpolation).Set([(v, v, v) for v in values])
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    srgb = 255 * (1.055 * values ** (1 / 2.4) - 0.055)
    material = scan.materials[0]
    if interpolation == "constant":
        assert 255 * material.base_color[0] == pytest.approx(srgb[0], abs=1)
        return
    assert material.image is not None
    pixels = np.asarray(material.image)[..., 0]
    x = scan.corner_uv[..., 0] * material.image.width
    y = (1 - scan.corner_uv[..., 1]) * material.image.height
    seen = pixels[y.astype(int), x.astype(int)]
    place = scan.vertices[scan.faces]
    first = (place[..., 0].max(axis=1) <= 1)[:, None].repeat(3, axis=1)
    corner = place[..., :2].round().astype(int)
    index = {(0, 0): 0, (1, 0): 1, (1, 1): 2, (0, 1): 3, (2, 0): 4, (2, 1): 5}
    for face in range(len(seen)):
        for k in range(3):
            vertex = index[(int(corner[face, k, 0]), int(corner[face, k, 1]))]
            wanted = {
                "uniform": 0 if first[face, k] else 1,
                "vertex": vertex,
                "faceVarying": ([0, 1, 2, 3] if first[face, k] else [1, 4, 5, 2]).index(vertex)
                + (0 if first[face, k] else 4),
            }[interpolation]
            assert seen[face, k] == pytest.approx(srgb[wanted], abs=2)


def test_subsets_of_faces_have_their_own_material(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/Root/box")
    mesh.CreatePointsAttr([(x, y, 0) for y in (0, 1) for x in range(4)])
    mesh.CreateFaceVertexCountsAttr([4, 4, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6])
    bind(mesh.GetPrim(), preview(stage, "/Root/Looks/Red", color=(1, 0, 0)))
    subset = UsdShade.MaterialBindingAPI(mesh.GetPrim()).CreateMaterialBindSubset("green", [1])
    bind(subset.GetPrim(), preview(stage, "/Root/Looks/Green", color=(0, 0.5, 0)))
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    colors = np.array([m.base_color for m in scan.materials])[scan.face_material]
    middle = scan.vertices[scan.faces].mean(axis=1)[:, 0]
    green = (middle > 1) & (middle < 2)
    assert np.allclose(colors[~green], (1, 0, 0))
    assert np.allclose(colors[green], (0, 0.735, 0), atol=0.01)


def test_written_labels_go_before_names(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    for k, name in enumerate(("Sofa_1", "thing", "other", "nothing")):
        square(stage, f"/Root/{name}/mesh_0", [(x + 3 * k, y, z) for x, y, z in SQUARE])
    new = stage.GetPrimAtPath("/Root/thing")
    UsdSemantics.LabelsAPI.Apply(new, "class").CreateLabelsAttr(["dining_chair"])
    old = stage.GetPrimAtPath("/Root/other")
    kind = Sdf.ValueTypeNames.String
    old.CreateAttribute("semantic:Semantics:params:semanticType", kind).Set("class")
    old.CreateAttribute("semantic:Semantics:params:semanticData", kind).Set("table")
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    named = {o.name: o.category for o in scan.objects}
    assert named["/Root/Sofa_1"] == "sofa"
    assert named["/Root/thing"] == "dining chair"
    assert named["/Root/other"] == "table"


@pytest.mark.parametrize(
    ("up", "metres", "expected"),
    [("Z", 1.0, ("z", "m")), ("Y", 0.0254, ("y", "in")), ("Z", 0.3, ("z", "0.3"))],
)
def test_conventions_of_the_stage_are_kept(
    up: str, metres: float, expected: tuple[str, str], tmp_path: Path
) -> None:
    stage = new_stage(tmp_path / "scene.usda", up, metres)
    square(stage, "/Root/floor", [(x / metres, y / metres, z) for x, y, z in SQUARE])
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert scan.up is not None
    assert scan.unit is not None
    assert (scan.up[0], scan.unit[0]) == expected
    extent = orient(scan, RepairConfig()).evidence["extent_m"]
    assert sorted(extent) == pytest.approx([0.0, 2.0, 2.0], abs=1e-4)


def test_unstated_conventions_are_left_open(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    square(stage, "/floor")
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert scan.up is None
    assert scan.unit is None


@pytest.mark.chain
def test_our_own_scene_reads_back(tmp_path: Path) -> None:
    parts = {
        "Floor_1": scans.sheet((0, 0), (4, 3), step=0.5),
        "Bed_1": scans.box((1, 1, 0.1), (2, 2, 0.6)),
    }
    source = scans.write_named_glb(parts, tmp_path / "scan.glb")
    bundle = repaired(source, tmp_path)
    scan = read_here(bundle.root / "scene.usdc")
    visual = bundle.visual()
    assert len(scan.faces) == len(visual.faces)
    area = [
        np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()
        for c in (scan.vertices[scan.faces], visual.vertices[visual.faces])
    ]
    assert area[0] == pytest.approx(area[1], rel=1e-6)
    assert {"bed", "floor"} <= {o.category for o in scan.objects}
    assert any(m.image is not None for m in scan.materials)


SHAPES = {
    "Cube": {"size": 3.0},
    "Plane": {"width": 10.0, "length": 4.0},
    "Sphere": {"radius": 1.5},
    "Cylinder": {"radius": 1.0, "height": 6.0},
    "Cone": {"radius": 1.0, "height": 6.0},
    "Capsule": {"radius": 1.0, "height": 6.0},
    "Cylinder_1": {"radiusBottom": 1.0, "radiusTop": 0.5, "height": 6.0},
    "Capsule_1": {"radiusBottom": 1.0, "radiusTop": 0.5, "height": 6.0},
}


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
@pytest.mark.parametrize("kind", SHAPES)
def test_plain_shapes_fill_the_extent_that_usd_tells(kind: str, axis: str) -> None:
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/shape", kind)
    for name, value in SHAPES[kind].items():
        prim.GetAttribute(name).Set(value)
    if kind not in ("Cube", "Sphere"):
        prim.GetAttribute("axis").Set(axis)
    found = simple_shape(prim)
    assert found is not None
    points, faces = found
    extent = np.array(
        UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), Usd.TimeCode.Default())
    )
    assert points.min(axis=0) == pytest.approx(extent[0], abs=1e-6)
    assert points.max(axis=0) == pytest.approx(extent[1], abs=1e-6)
    mesh = trimesh.Trimesh(points, faces)
    assert (mesh.area_faces > 0).all()
    if kind == "Plane":
        assert mesh.face_normals == pytest.approx(np.eye(3)["XYZ".index(axis)][None].repeat(2, 0))
    else:
        assert mesh.is_watertight
        assert mesh.volume > 0
    if kind in ("Cone", "Cylinder_1", "Capsule_1"):
        assert mesh.center_mass["XYZ".index(axis)] < -0.1


@pytest.mark.parametrize("kind", ["Volume", "ParticleField3DGaussianSplat"])
def test_splats_in_usd_are_no_mesh_and_meshes_beside_them_are_read(
    kind: str, tmp_path: Path
) -> None:
    stage = new_stage(tmp_path / "gauss.usda")
    prim = stage.DefinePrim("/Root/gauss", kind)
    if kind == "Volume":
        prim.CreateAttribute("omni:nurec:isNuRecVolume", Sdf.ValueTypeNames.Bool).Set(True)
    stage.Save()
    with pytest.raises(FileFormatError, match=r"Gaussian splats .*given as a scan"):
        read_here(tmp_path / "gauss.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/Root/floor")
    mesh.CreatePointsAttr(SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    stage.Save()
    scan = read_here(tmp_path / "gauss.usda")
    assert len(scan.faces) == 2
    assert any("Gaussian splats" in text and "left out" in text for text in scan.warnings)
