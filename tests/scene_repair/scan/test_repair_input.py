"""Reading scans: formats, axes, units, labels, and inconsistent files."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from trimesh.exchange.gltf import export_gltf
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from tests.support.scenes import scans
from tests.support.scenes.repairs import repaired
from vlnpe.formats.core.errors import FileFormatError, InputError, SceneError, UnknownNameError
from vlnpe.formats.core.frames import habitat_to_world_position
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.labels.files import read_labels
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.repair import repair_scene
from vlnpe.scene_repair.scan import soup
from vlnpe.scene_repair.scan.mesh import read_mesh
from vlnpe.scene_repair.scan.record import ScanMaterial
from vlnpe.scene_repair.scan.soup import weld

SIZE = (4.0, 3.5, 2.6)


def small_room() -> trimesh.Trimesh:
    """A room seen from inside, x 0…4, y 0…3.5, z 0…2.6, with two tables."""
    shell = scans.box((0, 0, 0), SIZE)
    shell.invert()
    parts = [shell, *scans.table(0.5, 0.5), *scans.table(2.5, 2.0)]
    return scans.joined([trimesh.Trimesh(p.vertices, p.faces) for p in parts])


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "ply", "stl", "off"])
def test_formats_give_the_same_triangles(suffix: str, tmp_path: Path) -> None:
    mesh = small_room()
    path = tmp_path / f"scan.{suffix}"
    if suffix in ("glb", "gltf"):
        mesh.apply_transform(scans.TO_Y_UP)
    if suffix == "gltf":
        for name, data in export_gltf(trimesh.Scene(mesh)).items():
            (tmp_path / name).write_bytes(data)
        (tmp_path / "model.gltf").rename(path)
    else:
        mesh.export(str(path))
    scan = read_mesh(path)
    assert len(scan.faces) == len(mesh.faces)
    world = scan.vertices @ orient(scan, RepairConfig()).source_to_world[:3, :3].T
    assert world.min(axis=0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)
    assert world.max(axis=0) == pytest.approx(SIZE, abs=1e-4)


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_up_axis_is_inferred(up: str, tmp_path: Path) -> None:
    mesh = small_room()
    axis = "xyz".index(up[-1])
    turn = np.eye(4)
    turn[:3, :3] = np.roll(np.eye(3), axis - 2, axis=0)
    if up.startswith("-"):
        # Half a turn about another axis, so that the rotation stays proper.
        flip = np.eye(4)
        flip[axis, axis] = flip[(axis + 1) % 3, (axis + 1) % 3] = -1
        turn = flip @ turn
    mesh.apply_transform(turn)
    path = tmp_path / "scan.ply"
    mesh.export(str(path))
    way = orient(read_mesh(path), RepairConfig())
    assert way.evidence["up"] == up
    assert np.linalg.det(way.source_to_world[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_unit_is_inferred(unit: str, factor: float, tmp_path: Path) -> None:
    mesh = small_room().apply_scale(factor)
    path = tmp_path / "scan.stl"
    mesh.export(str(path))
    way = orient(read_mesh(path), RepairConfig())
    assert way.evidence["unit"] == unit
    assert way.evidence["extent_m"] == pytest.approx(SIZE, abs=0.01)


def test_settings_overrule_the_inference(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    small_room().export(str(path))
    way = orient(read_mesh(path), RepairConfig(up="-z", unit="ft"))
    assert (way.evidence["up"], way.evidence["unit"]) == ("-z", "ft")
    assert way.evidence["extent_m"][2] == pytest.approx(2.6 * 0.3048, abs=1e-3)


def test_gltf_positions_keep_habitats_alignment(tmp_path: Path) -> None:
    source = scans.write_glb(scans.room(), tmp_path / "scan.glb")
    scan = read_mesh(source)
    way = orient(scan, RepairConfig())
    world = scan.vertices @ way.source_to_world[:3, :3].T + way.source_to_world[:3, 3]
    assert np.allclose(world, habitat_to_world_position(scan.vertices))
    assert np.allclose(way.source_to_world, way.habitat_to_world)


@pytest.mark.chain
@pytest.mark.parametrize("tilt_deg", [0.2, 2.0, 5.0])
def test_tilted_scan_is_levelled(tilt_deg: float, tmp_path: Path) -> None:
    tilt = trimesh.transformations.rotation_matrix(np.deg2rad(tilt_deg), (1, 0.3, 0))
    parts = [part.apply_transform(tilt) for part in scans.room()]
    bundle = repaired(parts, tmp_path)
    floor = bundle.floor(0)
    spread = np.ptp(floor.height_m[floor.covered])
    assert spread < (0.03 if tilt_deg < 0.3 else 0.01)
    assert bundle.source["levelled"] == (tilt_deg >= 0.3)
    rotation = bundle.habitat_to_world[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3))


def test_base_colors_become_srgb(tmp_path: Path) -> None:
    mesh = small_room()
    mesh.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[127, 0, 255, 255]))
    path = tmp_path / "scan.glb"
    mesh.export(str(path))
    color = read_mesh(path).materials[0].base_color
    assert color == pytest.approx((0.733, 0.0, 1.0), abs=0.01)


def test_vertex_colors_are_baked(tmp_path: Path) -> None:
    mesh = small_room()
    rng = np.random.default_rng(0)
    # Ramps that stay in range when continued beyond the triangle are exact.
    colors = rng.integers(100, 155, (len(mesh.vertices), 4), dtype=np.uint8)
    mesh.visual = ColorVisuals(mesh, vertex_colors=colors)
    path = tmp_path / "scan.ply"
    mesh.export(str(path))
    scan = read_mesh(path)
    image = scan.materials[0].image
    assert image is not None
    pixels = np.asarray(image).astype(float)
    # At a triangle's corner lies the vertex's colour, in its middle the mean of the three.
    for weights in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1 / 3, 1 / 3, 1 / 3]):
        uv = np.einsum("k,fkd->fd", weights, scan.corner_uv)
        x, y = uv[:, 0] * image.width - 0.5, (1 - uv[:, 1]) * image.height - 0.5
        x0, y0 = np.floor(x + 1e-4).astype(int), np.floor(y + 1e-4).astype(int)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        seen = (pixels[y0, x0] * (1 - fx) + pixels[y0, x0 + 1] * fx) * (1 - fy) + (
            pixels[y0 + 1, x0] * (1 - fx) + pixels[y0 + 1, x0 + 1] * fx
        ) * fy
        corner = colors[mesh.faces][..., :3].astype(float)
        assert np.abs(seen - np.einsum("k,fkd->fd", weights, corner)).max() < 3


def test_colours_of_many_faces_take_several_images(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soup, "MAX_FACES", 10)
    mesh = scans.sheet((0, 0), (4, 3), step=1.0)
    colors = np.repeat(np.arange(len(mesh.faces), dtype=np.uint8)[:, None, None], 9).reshape(
        -1, 3, 3
    )
    uv = np.zeros((len(mesh.faces), 3, 2), np.float32)
    look = ScanMaterial("painted", (1.0, 1.0, 1.0))
    part = soup.Part("", "", mesh.vertices, mesh.faces, uv, look, colors)
    scan = soup.merge_parts([part], [])
    assert len(scan.materials) == 3
    for face in range(len(scan.faces)):
        image = scan.materials[scan.face_material[face]].image
        assert image is not None
        x, y = scan.corner_uv[face, 0] * (image.width, -image.height) + (0, image.height)
        assert np.asarray(image)[int(y), int(x)].tolist() == [face] * 3


def test_textured_obj_with_its_material_file(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8), (10, 200, 30)).save(tmp_path / "paint.png")
    (tmp_path / "scan.mtl").write_text("newmtl paint\nKd 1 1 1\nmap_Kd paint.png\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\no Floor_1\nv 0 0 0\nv 4 0 0\nv 4 0 3\nv 0 0 3\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl paint\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    scan = read_mesh(tmp_path / "scan.obj")
    image = scan.materials[0].image
    assert image is not None
    assert np.asarray(image.convert("RGB"))[0, 0].tolist() == [10, 200, 30]
    assert scan.corner_uv.max() == 1.0


def test_bad_faces_are_dropped_with_a_warning(tmp_path: Path) -> None:
    (tmp_path / "scan.obj").write_text(
        "v 0 0 0\nv 4 0 0\nv 4 3 0\nv nan 0 0\nv 1e30 0 0\nv 2 0 0\n"
        "f 1 2 3\nf 1 2 4\nf 1 2 5\nf 1 2 6\nf 1 1 2\n"
    )
    scan = read_mesh(tmp_path / "scan.obj")
    assert len(scan.faces) == 1
    text = " ".join(scan.warnings)
    assert "invalid coordinates" in text
    assert "without area" in text


@pytest.mark.chain
def test_stray_triangles_far_away_do_not_matter(tmp_path: Path) -> None:
    stray = trimesh.Trimesh([(600, 0, 0), (600.1, 0, 0), (600, 0.1, 0.5)], [[0, 1, 2]])
    bundle = repaired([*scans.room(), stray], tmp_path)
    assert bundle.source["extent_m"][:2] == pytest.approx((5.2, 4.2), abs=0.01)
    assert max(bundle.floor(0).grid.shape) < 150
    # It is still part of what is seen.
    assert bundle.visual().vertices[:, 0].max() > 599


def test_weld_merges_equal_places_only() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [1, 1e-9, 0], [5, 5, 5]])
    points, faces = weld(vertices, np.array([[0, 1, 2], [3, 4, 2]]))
    assert len(points) == 4
    assert np.allclose(points[faces], vertices[[[0, 1, 2], [3, 4, 2]]])


@pytest.mark.chain
def test_own_labels(tmp_path: Path) -> None:
    table = {"name": "T1", "category": "table", "lower": [0.9, 0, -2.1], "upper": [2.1, 0.8, -0.9]}
    kitchen = {"name": "K", "category": "room:kitchen", "lower": [0, 0, -4], "upper": [5, 3, 0]}
    labels = {"frame": "source", "objects": [table, kitchen]}
    (tmp_path / "scan.labels.json").write_text(json.dumps(labels))
    bundle = repaired(scans.room(more=scans.table(1.0, 1.0)), tmp_path)
    by_name = {o.name: o for o in bundle.objects}
    assert by_name["T1"].lower_m == pytest.approx((0.9, 0.9, 0.0))
    assert by_name["T1"].upper_m == pytest.approx((2.1, 2.1, 0.8))
    assert by_name["K"].category == "room:kitchen"
    assert by_name["T1"].level == 0
    visual = bundle.visual()
    centers = visual.vertices[visual.faces].mean(axis=1)
    labelled = visual.face_label == bundle.labels.index("table")
    assert labelled.any()
    # The floor under the table is still floor, and not the table's.
    assert centers[labelled][:, 2].min() > 0.0
    assert "room:kitchen" not in bundle.labels


def test_headset_labels(shared_scenes: Path) -> None:
    boxes = read_labels(shared_scenes / "quest_office_small.glb")
    floor = next(b for b in boxes if b.category == "floor")
    assert np.ptp(floor.corners(), axis=0) == pytest.approx((2.46, 0.1, 2.42), abs=0.03)
    ceiling = next(b for b in boxes if b.category == "ceiling")
    for wall in (b for b in boxes if b.category == "wall"):
        corners = wall.corners()
        assert corners[:, 1].min() == pytest.approx(floor.center[1], abs=0.02)
        assert corners[:, 1].max() == pytest.approx(ceiling.center[1], abs=0.02)
    desk = max((b for b in boxes if b.category == "table"), key=lambda b: np.prod(b.half))
    assert desk.corners()[:, 1].min() == pytest.approx(floor.center[1], abs=0.03)


def refused(source: Path, config: RepairConfig | None = None) -> str:
    out = source.parent / "out"
    out.mkdir()
    with pytest.raises(InputError) as caught:
        repair_scene(source, out, config)
    assert not list(out.iterdir())
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "nothing.glb")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("house.ifc", "IfcConvert house.ifc house.glb"),
        ("house.E57", "CloudCompare"),
        ("my.house.dae", "assimp export my.house.dae my.house.glb"),
        ("house.fbx", "Blender"),
        ("house.sog", "splat-transform house.sog house.ply"),
        ("house.txt", "unknown file type '.txt'"),
    ],
)
def test_unsupported_formats_name_the_converter(name: str, expected: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"anything")
    message = refused(tmp_path / name)
    assert expected in message
    assert ".glb, " in message


@pytest.mark.parametrize("suffix", ["glb", "gltf", "obj", "ply", "stl", "off"])
@pytest.mark.parametrize("raw", [b"", b"not a mesh at all", b"\x00" * 200, b"ply\nformat"])
def test_not_a_mesh(suffix: str, raw: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"scan.{suffix}"
    path.write_bytes(raw)
    assert str(path) in refused(path)


def test_empty_mesh(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
        "property float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
    assert "triangle" in refused(path)


def test_no_floor(tmp_path: Path) -> None:
    parts = scans.walls((0, 0), (5, 4))
    upright = [
        trimesh.Trimesh(p.vertices, p.faces[np.abs(p.face_normals[:, 2]) < 0.5]) for p in parts
    ]
    message = refused(scans.write_glb(upright, tmp_path / "scan.glb"))
    assert "no floor" in message
    assert "--floor" in message


@pytest.mark.parametrize(("scale", "size"), [(0.01, "52 mm"), (1000.0, "5.2 km")])
def test_impossible_scale(scale: float, size: str, tmp_path: Path) -> None:
    parts = [p.apply_scale(scale) for p in scans.room()]
    message = refused(scans.write_glb(parts, tmp_path / "scan.glb"))
    assert size in message
    assert "valid: 1 m" in message


@pytest.mark.parametrize("field", [{"up": "w"}, {"unit": "parsec"}])
def test_unknown_settings(field: dict[str, Any]) -> None:
    with pytest.raises(UnknownNameError, match="valid: "):
        RepairConfig(**field)


def test_glb_with_a_false_header(tmp_path: Path) -> None:
    source = scans.write_glb(scans.room(), tmp_path / "scan.glb")
    data = bytearray(source.read_bytes())
    struct.pack_into("<I", data, 12, 0xFFFFFFF0)
    source.write_bytes(bytes(data))
    with pytest.raises(FileFormatError):
        read_mesh(source)


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("sound")
    mesh = scans.sheet((0, 0), (2, 2), step=1.0)
    found = {}
    for suffix in ("glb", "obj", "ply", "stl"):
        mesh.export(str(folder / f"scan.{suffix}"))
        found[suffix] = (folder / f"scan.{suffix}").read_bytes()
    return found


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_bytes_never_crash(
    sound_files: dict[str, bytes], tmp_path: Path, data: st.DataObject
) -> None:
    suffix = data.draw(st.sampled_from(sorted(sound_files)))
    raw = bytearray(sound_files[suffix])
    for _ in range(data.draw(st.integers(1, 6))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    raw = raw[: data.draw(st.integers(len(raw) // 2, len(raw)))]
    path = tmp_path / f"scan.{suffix}"
    path.write_bytes(bytes(raw))
    try:
        scan = read_mesh(path)
    except (FileFormatError, SceneError):
        return
    assert np.isfinite(scan.vertices).all()
    assert scan.faces.min() >= 0
    assert scan.faces.max() < len(scan.vertices)
