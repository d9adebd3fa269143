"""Reading USD: composition, visibility, names, colours, and malicious files."""

# usd-core ships no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSemantics, UsdShade, UsdUtils

from tests.support.scenes import scans
from tests.support.scenes.damage import USDA
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.scan import dispatch as read_scan_module
from vlnpe.scene_repair.scan import sandbox as reader_child
from vlnpe.scene_repair.scan.dispatch import read_scan, scan_of
from vlnpe.scene_repair.scan.readings import LookRef
from vlnpe.scene_repair.scan.record import Scan
from vlnpe.scene_repair.usd import package as usd_package
from vlnpe.scene_repair.usd import read_stage as read_usd
from vlnpe.scene_repair.usd.shapes import simple_shape

SQUARE = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]


def read_here(path: Path) -> Scan:
    """Without the child process, which takes a second to start."""
    return scan_of(path, read_usd.read(path))


def new_stage(path: Path, up: str = "Z", metres: float = 1.0) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Root").GetPrim())
    return stage


def square(stage: Usd.Stage, path: str, points: object = SQUARE) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    return mesh


def save(stage: Usd.Stage) -> None:
    stage.GetRootLayer().Save()


def preview(
    stage: Usd.Stage, path: str, color: object = None, file: str = "", varname: str = "st"
) -> UsdShade.Material:
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    port = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if color is not None:
        port.Set(color)
    if file:
        reader = UsdShade.Shader.Define(stage, f"{path}/Reader")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(varname)
        texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        port.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    material.CreateSurfaceOutput().ConnectToSource(
        shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    )
    return material


def bind(prim: Usd.Prim, material: UsdShade.Material) -> None:
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def home(folder: Path, suffix: str = "usda") -> Path:
    """A scene as GRScenes lays it out: models in folders, referenced and instanced, in cm."""
    (folder / "models" / "bed").mkdir(parents=True)
    (folder / "Textures").mkdir()
    Image.new("RGB", (8, 8), (10, 200, 30)).save(folder / "Textures" / "wood.png")
    model = new_stage(folder / "models" / "bed" / f"instance.{suffix}", metres=0.01)
    mesh = square(
        model, "/Root/Group/Component/mesh_0", [(100 * x, 100 * y, 50) for x, y, _ in SQUARE]
    )
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    primvar.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    bind(mesh.GetPrim(), preview(model, "/Root/Looks/Wood", file="../../Textures/wood.png"))
    save(model)
    stage = new_stage(folder / f"scene.{suffix}", metres=0.01)
    square(stage, "/Root/Meshes/Base/floor/model_0", [(300 * x, 300 * y, 0) for x, y, _ in SQUARE])
    for k in range(2):
        prim = stage.DefinePrim(f"/Root/Meshes/Furnitures/bed/model_6f12ab34cd56ef78_{k}", "Xform")
        child = stage.DefinePrim(prim.GetPath().AppendChild("Instance"), "Xform")
        reference = f"./models/bed/instance.{suffix}"
        if k:
            child.GetPayloads().AddPayload(reference)
        else:
            child.GetReferences().AddReference(reference)
        child.SetInstanceable(True)
        UsdGeom.XformCommonAPI(prim).SetTranslate((300.0 * k, 0, 0))
    save(stage)
    return folder / f"scene.{suffix}"


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
    [("Z", 1.0, ("z", "m")), ("Y", 0.0254, ("y", "in")), ("Z", 0.3, ("z", "m"))],
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


def test_our_own_scene_reads_back(tmp_path: Path) -> None:
    parts = {
        "Floor_1": scans.sheet((0, 0), (4, 3), step=0.5),
        "Bed_1": scans.box((1, 1, 0.1), (2, 2, 0.6)),
    }
    source = scans.write_named_glb(parts, tmp_path / "scan.glb")
    (tmp_path / "out").mkdir()
    bundle = repair_scene(source, tmp_path / "out", RepairConfig(picture_px=200))
    scan = read_here(tmp_path / "out" / "scene.usdc")
    visual = bundle.visual()
    assert len(scan.faces) == len(visual.faces)
    area = [
        np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum()
        for c in (scan.vertices[scan.faces], visual.vertices[visual.faces])
    ]
    assert area[0] == pytest.approx(area[1], rel=1e-6)
    assert {"bed", "floor"} <= {o.category for o in scan.objects}
    assert any(m.image is not None for m in scan.materials)


@pytest.mark.parametrize("way", ["reference", "payload", "sublayer"])
@pytest.mark.parametrize(
    "target", ["../outside.usda", "ABSOLUTE", "http://x.test/a.usda", "link.usda"]
)
def test_layers_outside_the_folder_are_refused(way: str, target: str, tmp_path: Path) -> None:
    outside = new_stage(tmp_path / "outside.usda")
    square(outside, "/Root/secret")
    save(outside)
    folder = tmp_path / "scan"
    folder.mkdir()
    (folder / "link.usda").symlink_to(tmp_path / "outside.usda")
    target = str(tmp_path / "outside.usda") if target == "ABSOLUTE" else target
    path = folder / "scene.usda"
    arc = {
        "reference": f'def Xform "a" (references = @{target}@) {{}}',
        "payload": f'def Xform "a" (payload = @{target}@) {{}}',
        "sublayer": "",
    }[way]
    head = f"(subLayers = [@{target}@])" if way == "sublayer" else ""
    path.write_text(f"#usda 1.0\n{head}\n{arc}\n")
    with pytest.raises(FileFormatError, match="leaves the scan's folder") as caught:
        read_here(path)
    assert caught.value.path.name == "scene.usda"
    assert target in str(caught.value)


def test_hidden_ways_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usda"
    path.write_text(
        '#usda 1.0\n(expressionVariables = {string X = "/etc/a.usda"})\n'
        'def Xform "a" (references = @`"${X}"`@) {}\n'
    )
    with pytest.raises(FileFormatError, match="expression"):
        read_here(path)
    path.write_text(
        '#usda 1.0\ndef Xform "a" (prepend variantSets = "v"\nvariants = {string v = "one"})\n{\n'
        'variantSet "v" = {\n"one" (references = @../a.usda@) {\n}\n}\n}\n'
    )
    with pytest.raises(FileFormatError, match="leaves the scan's folder"):
        read_here(path)
    path.write_text(
        '#usda 1.0\ndef Mesh "a" (clips = {dictionary default = {\n'
        "asset[] assetPaths = [@/etc/a.usda@]}}) {}\n"
    )
    with pytest.raises(FileFormatError, match="value clips"):
        read_here(path)


def test_a_missing_layer_is_reported_and_the_rest_is_read(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/floor")
    stage.DefinePrim("/Root/bed").GetReferences().AddReference("./bed.usda")
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert len(scan.faces) == 2
    assert any("'./bed.usda' is missing" in w for w in scan.warnings)


@pytest.mark.parametrize("where", ["../secret.png", "/etc/hostname", "http://x.test/a.png"])
def test_pictures_outside_the_folder_are_left_out(where: str, tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "secret.png")
    (tmp_path / "scan").mkdir()
    stage = new_stage(tmp_path / "scan" / "scene.usda")
    mesh = square(stage, "/Root/floor")
    bind(mesh.GetPrim(), preview(stage, "/Root/Looks/A", file=where))
    save(stage)
    scan = read_here(tmp_path / "scan" / "scene.usda")
    assert all(m.image is None for m in scan.materials)
    assert any("leaves the scan's folder" in w for w in scan.warnings)


def test_references_in_a_circle_are_refused(tmp_path: Path) -> None:
    for one, other in (("scene", "b"), ("b", "scene")):
        (tmp_path / f"{one}.usda").write_text(
            f'#usda 1.0\n(defaultPrim = "R")\ndef Xform "R" (references = @./{other}.usda@) {{}}\n'
        )
    with pytest.raises(FileFormatError, match="circular") as caught:
        read_here(tmp_path / "scene.usda")
    assert "0x" not in str(caught.value)


def test_sublayers_in_a_circle_are_refused(tmp_path: Path) -> None:
    for one, other in (("scene", "b"), ("b", "scene")):
        (tmp_path / f"{one}.usda").write_text(f"#usda 1.0\n(subLayers = [@./{other}.usda@])\n")
    with pytest.raises(FileFormatError, match="circular") as caught:
        read_here(tmp_path / "scene.usda")
    assert "0x" not in str(caught.value)


def test_packed_package_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as package:
        package.writestr("scene.usda", "#usda 1.0\n" + " " * 10_000_000)
    with pytest.raises(FileFormatError, match="compressed"):
        read_here(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("../scene.usda", "#usda 1.0\n"),
        ("scene.usda", '#usda 1.0\ndef Xform "a" (references = @../../a.usda@) {}\n'),
        ("scene.usda", '#usda 1.0\ndef Xform "a" (references = @/etc/a.usda@) {}\n'),
        ("scene.txt", "hello"),
    ],
)
def test_package_that_climbs_out_is_refused(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr(name, text)
    with pytest.raises(FileFormatError, match=r"scene\.usdz"):
        read_here(path)


def test_package_with_contradictory_sizes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.usdz"
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("scene.usda", "#usda 1.0\n")
    raw = bytearray(path.read_bytes())
    at = raw.rindex(b"PK\x01\x02")
    for offset in (20, 24):
        raw[at + offset : at + offset + 4] = (3_000_000_000).to_bytes(4, "little")
    path.write_bytes(bytes(raw))
    with pytest.raises(FileFormatError, match="bytes in total"):
        read_here(path)


def test_instancing_bomb_ends_in_an_error(tmp_path: Path) -> None:
    """Each level instances the one below ten times: ten to the ninth squares from a small file."""
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/L0/square")
    for k in range(1, 10):
        one = UsdGeom.PointInstancer.Define(stage, f"/Root/L{k}")
        one.CreatePrototypesRel().AddTarget(f"/Root/L{k - 1}")
        one.CreateProtoIndicesAttr([0] * 10)
        one.CreatePositionsAttr([(0, 0, n) for n in range(10)])
    save(stage)
    with pytest.raises(FileFormatError, match=r"more than|not read within|needs more"):
        reader_child.read_in_child("usd", tmp_path / "scene.usda", seconds=4)


@pytest.mark.parametrize(
    "raw", [b"", b"#usda 1.0\ndef Mesh {", b"PXR-USDC" + b"\xff" * 200, b"hello"]
)
@pytest.mark.parametrize("suffix", ["usd", "usda", "usdc", "usdz"])
def test_damaged_files_are_named(suffix: str, raw: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"scene.{suffix}"
    path.write_bytes(raw)
    with pytest.raises(FileFormatError, match=rf"scene\.{suffix}"):
        read_scan(path)


def test_inconsistent_faces_are_dropped(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "scene.usda")
    square(stage, "/Root/floor")
    bad = square(stage, "/Root/bad")
    bad.GetFaceVertexCountsAttr().Set([3, 3])
    bad.GetFaceVertexIndicesAttr().Set([0, 1, 2, 0, 1, 99])
    lying = square(stage, "/Root/lying")
    lying.GetFaceVertexCountsAttr().Set([2_000_000_000])
    negative = square(stage, "/Root/negative")
    negative.GetFaceVertexCountsAttr().Set([-4, 8])
    nan = square(stage, "/Root/nan", [(np.nan, 0, 0), *SQUARE[1:]])
    assert nan
    save(stage)
    scan = read_here(tmp_path / "scene.usda")
    assert len(scan.faces) == 2 + 1 + 0
    text = " ".join(scan.warnings)
    for part in ("out of range", "/Root/lying", "/Root/negative", "invalid coordinates"):
        assert part in text


def test_hanging_and_greedy_readers_are_ended(tmp_path: Path) -> None:
    path = home(tmp_path)
    with pytest.raises(FileFormatError, match=r"scene\.usda: not read within 0 s"):
        reader_child.read_in_child("usd", path, seconds=0.05)
    with pytest.raises(FileFormatError, match=r"scene\.usda: (needs more than|its reader failed)"):
        reader_child.read_in_child("usd", path, memory_bytes=200 << 20)


def assert_read_or_named(path: Path) -> None:
    """Assert that a damaged file is read as finite vertices, or named in an error of one line."""
    try:
        scan = read_scan(path)
    except FileFormatError as error:
        assert error.path == path
        assert "\n" not in str(error)
    else:
        assert np.isfinite(scan.vertices).all()


def test_layer_that_crashed_the_library_is_read_or_refused(tmp_path: Path) -> None:
    """Found by fuzzing: these two bytes changed had USD abort its process, in one order of tables.

    USD does not write its tables in the same order every time.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(USDA.decode())
    path = tmp_path / "scene.usdc"
    layer.Export(str(path))
    raw = bytearray(path.read_bytes())
    raw[88], raw[462] = 1, 0
    path.write_bytes(bytes(raw))
    assert_read_or_named(path)


def test_mutated_binary_layers_end_in_typed_errors(tmp_path: Path) -> None:
    """Bytes all over a binary layer, in one child process each: some of them crash it."""
    stage = new_stage(tmp_path / "sound.usdc")
    square(stage, "/Root/floor")
    save(stage)
    raw = (tmp_path / "sound.usdc").read_bytes()
    rng = np.random.default_rng(0)
    for k in range(2):
        data = bytearray(raw)
        for at in rng.integers(8, len(raw), 12):
            data[at] = int(rng.integers(0, 256))
        path = tmp_path / f"scene{k}.usdc"
        path.write_bytes(bytes(data))
        assert_read_or_named(path)


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


def test_enormous_picture_files_leave_the_colour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Image.new("RGB", (8, 8), (255, 0, 0)).save(tmp_path / "paint.png")
    with zipfile.ZipFile(tmp_path / "scene.usdz", "w") as package:
        package.write(tmp_path / "paint.png", "paint.png")
    looks = [
        LookRef("a", (1.0, 0.0, 0.0), str(tmp_path / "paint.png")),
        LookRef("b", (1.0, 0.0, 0.0), str(tmp_path / "scene.usdz"), "paint.png"),
    ]
    folder, warnings = tmp_path.resolve(), []
    found = read_scan_module._materials(folder, looks, warnings)
    assert all(m.image is not None for m in found)
    monkeypatch.setattr(read_scan_module, "MAX_BYTES", 10)
    monkeypatch.setattr(usd_package, "MAX_MEMBER_BYTES", 10)
    found = read_scan_module._materials(folder, looks, warnings)
    assert all(m.image is None for m in found)
    assert len(warnings) == 2


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
