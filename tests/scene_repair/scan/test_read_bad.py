"""Inconsistent, truncated and malicious files: a typed error, or a warning and a sound result."""

from __future__ import annotations

import base64
import io
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from tests.support.scenes import scans
from tests.support.scenes.damage import damage, picture_bytes, sound_files
from vlnpe.formats.core.errors import FileFormatError, InputError, SceneError
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.gltf import checks as gltf_check
from vlnpe.scene_repair.gltf.file import GltfFile
from vlnpe.scene_repair.grid import columns as columns_module
from vlnpe.scene_repair.grid.columns import sample_columns
from vlnpe.scene_repair.scan import images
from vlnpe.scene_repair.scan.big_png import shrink_png
from vlnpe.scene_repair.scan.dispatch import read_scan, scan_of
from vlnpe.scene_repair.scan.headers import read_header
from vlnpe.scene_repair.scan.mesh import _load, _parts, read_mesh
from vlnpe.scene_repair.scan.record import Scan
from vlnpe.scene_repair.scan.resolver import ConfinedResolver
from vlnpe.scene_repair.usd import read_stage as read_usd

pytestmark = pytest.mark.chain


def check_sound(scan: Scan) -> None:
    assert np.isfinite(scan.vertices).all()
    assert np.isfinite(scan.corner_uv).all()
    assert scan.faces.min() >= 0
    assert scan.faces.max() < len(scan.vertices)
    assert len(scan.faces) == len(scan.corner_uv) == len(scan.face_material)
    assert scan.face_material.min() >= 0
    assert scan.face_material.max() < len(scan.materials)
    assert scan.face_object.max() < max(len(scan.objects), 1)


def glb(tree: dict[str, Any], data: bytes = b"") -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        data += b"\0" * (-len(data) % 4)
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle_tree(**more: Any) -> tuple[dict[str, Any], bytes]:
    """A GLB with one triangle, by hand."""
    data = np.array([0, 0, 0, 2, 0, 0, 2, 0, 2], "<f4").tobytes() + bytes([0, 0, 1, 0, 2, 0])
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return {**tree, **more}, data


def test_handmade_triangle_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(*triangle_tree()))
    scan = read_mesh(path)
    check_sound(scan)
    assert len(scan.faces) == 1


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            {
                "accessors": [
                    {"bufferView": 0, "componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}
                ]
            },
            "4,000,000,000 elements",
        ),
        (
            {"accessors": [{"componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}]},
            "without data",
        ),
        ({"bufferViews": [{"buffer": 0, "byteLength": 10**9}]}, "1,000,000,000 of"),
        (
            {"bufferViews": [{"buffer": 0, "byteOffset": float("inf"), "byteLength": 36}]},
            "OverflowError",
        ),
        (
            {
                "accessors": [
                    {"bufferView": 0, "componentType": 5126, "count": 1e999, "type": "VEC3"}
                ]
            },
            "OverflowError",
        ),
        (
            {"accessors": [{"componentType": 5126, "count": 6_000_000, "type": "VEC3"}] * 2},
            "12,000,000 elements without data",
        ),
        ({"buffers": [{"byteLength": 42, "uri": "../x.bin"}]}, "leaves the scan's folder"),
        ({"buffers": [{"byteLength": 42, "uri": "/etc/hostname"}]}, "leaves the scan's folder"),
        ({"buffers": [{"byteLength": 42, "uri": "http://x.test/a.bin"}]}, "leaves the scan's"),
        ({"buffers": [{"byteLength": 42, "uri": "%2e%2e/x.bin"}]}, "leaves the scan's folder"),
        ({"buffers": [{"byteLength": 42, "uri": "none.bin"}]}, "missing"),
        ({"buffers": [{"byteLength": 42, "uri": "data:,!!!"}]}, "base64"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "its own ancestor"),
        ({"nodes": [{"mesh": 7}]}, "mesh 7; there are 1"),
        ({"nodes": [{"mesh": 0, "children": [9]}]}, "node 9 does not exist; there are 1"),
        ({"nodes": [{"mesh": 0}] * 60_000, "scenes": [{"nodes": list(range(60_000))}]}, "60,000"),
        ({"nodes": [{"children": [k + 1]} for k in range(2000)] + [{"mesh": 0}]}, "deep"),
        ({"materials": True}, "not a list of objects"),
        ({"asset": {"version": "1.0"}}, "valid: 2"),
        (
            {
                "meshes": [
                    {
                        "primitives": [
                            {
                                "attributes": {"POSITION": 0},
                                "indices": 1,
                                "extensions": {
                                    "KHR_draco_mesh_compression": {
                                        "bufferView": 0,
                                        "attributes": {},
                                    }
                                },
                            }
                        ]
                    }
                ]
            },
            "Draco",
        ),
        (
            {
                "bufferViews": [
                    {"buffer": 0, "byteLength": 36, "extensions": {"EXT_meshopt_compression": {}}}
                ]
            },
            "meshopt",
        ),
    ],
)
def test_inconsistent_gltf_is_refused(change: dict[str, Any], what: str, tmp_path: Path) -> None:
    (tmp_path / "x.bin").write_bytes(bytes(42))
    folder = tmp_path / "scan"
    folder.mkdir()
    path = folder / "scan.glb"
    path.write_bytes(glb(*triangle_tree(**change)))
    with pytest.raises(FileFormatError, match=what) as caught:
        read_mesh(path)
    assert caught.value.path == path


@pytest.mark.parametrize("rotation", [10**400, float("inf"), float("nan"), "a"])
def test_impossible_texture_transforms_leave_the_colour(rotation: Any, tmp_path: Path) -> None:
    png = base64.b64encode(picture_bytes(4, 4)).decode()
    tree, data = picture_tree(f"data:image/png;base64,{png}")
    info = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"] = {"KHR_texture_transform": {"rotation": rotation}}
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    scan = read_mesh(path)
    check_sound(scan)
    assert scan.materials[0].image is None
    assert any("its picture cannot be read" in w for w in scan.warnings)


def test_a_buffer_named_often_is_read_once(tmp_path: Path) -> None:
    tree, data = triangle_tree()
    (tmp_path / "a.bin").write_bytes(data)
    tree["buffers"] = [{"byteLength": len(data), "uri": "./" * k + "a.bin"} for k in range(50)]
    path = tmp_path / "scan.gltf"
    path.write_text(json.dumps(tree))
    resolver = ConfinedResolver(tmp_path)
    file = GltfFile(path, resolver)
    assert all(file.buffer(k) is file.buffer(0) for k in range(50))
    assert file.held_bytes() == len(data)
    assert len(read_mesh(path).faces) == 1


@pytest.mark.parametrize(
    ("limit", "value", "what"),
    [
        ("MAX_VERTICES", 8, "9 vertices"),
        ("SPARE_BYTES", -40, "accessors refer to"),
        ("MAX_REPEATED", 8, "so often that they become 9"),
    ],
)
def test_small_files_that_expand_beyond_a_limit_are_refused(
    limit: str, value: int, what: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    tree, data = triangle_tree()
    tree["meshes"] *= 3
    tree["nodes"] = [{"mesh": 0}] * 9
    tree["scenes"] = [{"nodes": list(range(9))}]
    if limit == "SPARE_BYTES":
        tree["accessors"] += [tree["accessors"][0]] * 3
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    assert len(read_mesh(path).faces) == 9
    monkeypatch.setattr(gltf_check, limit, value)
    with pytest.raises(FileFormatError, match=what):
        read_mesh(path)


def test_pieces_of_a_shared_buffer_keep_their_own_vertices(tmp_path: Path) -> None:
    places = np.random.default_rng(0).uniform(0, 5, (3000, 3)).astype("<f4")
    tree, _ = triangle_tree()
    tree["bufferViews"] = [{"buffer": 0, "byteLength": places.nbytes}]
    tree["accessors"] = tree["accessors"][:1]
    tree["accessors"][0]["count"] = len(places)
    data = places.tobytes()
    for k in range(100):
        index = np.arange(3 * k, 3 * k + 3, dtype="<u4").tobytes()
        tree["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": 12})
        tree["accessors"].append(
            {"bufferView": k + 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
        )
        data += index
    tree["buffers"][0]["byteLength"] = len(data)
    tree["meshes"] = [
        {
            "primitives": [
                {"attributes": {"POSITION": 0, "NORMAL": 0}, "indices": k + 1} for k in range(100)
            ]
        }
    ]
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    file = GltfFile(path, ConfinedResolver(tmp_path))
    parts = _parts(_load(path, file.without_images(), ConfinedResolver(tmp_path)), True, [])
    assert [len(part.vertices) for part in parts] == [3] * 100
    found = np.concatenate([p.vertices[p.faces].reshape(-1, 3) for p in parts])
    assert sorted(map(tuple, found)) == sorted(map(tuple, places[:300].astype(float)))


def test_indices_out_of_range_are_dropped(tmp_path: Path) -> None:
    tree, data = triangle_tree()
    data = data[:36] + struct.pack("<6H", 0, 1, 2, 0, 1, 60_000)
    tree["buffers"][0]["byteLength"] = tree["bufferViews"][1]["byteLength"] = len(data)
    tree["bufferViews"][1]["byteLength"] = 12
    tree["accessors"][1]["count"] = 6
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    try:
        scan = read_mesh(path)
    except FileFormatError:
        return
    check_sound(scan)
    assert len(scan.faces) == 1


def picture_tree(uri: str) -> tuple[dict[str, Any], bytes]:
    tree, data = triangle_tree(
        images=[{"uri": uri}],
        textures=[{"source": 0}],
        materials=[{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    primitive["attributes"]["TEXCOORD_0"] = 2
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": 24})
    tree["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2"})
    data += bytes(2) + np.array([0, 0, 1, 0, 1, 1], "<f4").tobytes()
    tree["bufferViews"][2]["byteOffset"] = 44
    tree["buffers"][0]["byteLength"] = len(data)
    return tree, data


def test_texture_transform_is_applied(tmp_path: Path) -> None:
    png = base64.b64encode(picture_bytes(4, 4)).decode()
    tree, data = picture_tree(f"data:image/png;base64,{png}")
    info = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"] = {"KHR_texture_transform": {"offset": [0.5, 0.25], "scale": [2, 4]}}
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    scan = read_mesh(path)
    assert scan.materials[0].name == "paint"
    assert scan.materials[0].image is not None
    # Written v down: (0, 0), (1, 0), (1, 1).
    down = scan.corner_uv[0] * (1, -1) + (0, 1)
    assert sorted(map(tuple, np.round(down, 5).tolist())) == [(0.5, 0.25), (2.5, 0.25), (2.5, 4.25)]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("../secret.png", "leaves the scan's folder"),
        ("/etc/hostname", "leaves the scan's folder"),
        ("http://x.test/a.png", "leaves the scan's folder"),
        ("link.png", "leaves the scan's folder"),
        ("none.png", "missing"),
        ("broken.png", "cannot be read"),
        ("cut.png", "damaged"),
        ("folder.png", "is a folder"),
    ],
)
def test_unusable_pictures_leave_the_colour(name: str, what: str, tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "secret.png")
    folder = tmp_path / "scan"
    (folder / "folder.png").mkdir(parents=True)
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / "broken.png").write_bytes(b"no picture")
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "cut.png")
    (folder / "cut.png").write_bytes((folder / "cut.png").read_bytes()[:2000])
    (folder / "scan.glb").write_bytes(glb(*picture_tree(name)))
    (folder / "scan.mtl").write_text(f"newmtl paint\nKd 0.2 0.4 0.6\nmap_Kd {name}\n")
    (folder / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    for file in ("scan.glb", "scan.obj"):
        scan = read_mesh(folder / file)
        check_sound(scan)
        assert all(m.image is None for m in scan.materials), file
        assert any(what in w for w in scan.warnings), (file, scan.warnings)


SIGNATURE = b"\x89PNG\r\n\x1a\n"


def big_png(width: int, height: int, color: int = 2) -> bytes:
    """A PNG of huge size in few bytes."""
    channels = {0: 1, 2: 3, 6: 4}[color]
    row = b"\0" + bytes([10, 200, 30, 255][:channels]) * width
    packer = zlib.compressobj(1)
    packed = b"".join([*(packer.compress(row) for _ in range(height)), packer.flush()])

    def chunk(kind: bytes, body: bytes) -> bytes:
        crc = zlib.crc32(kind + body)
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", crc)

    head = struct.pack(">IIBBBBB", width, height, 8, color, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("name", ["a.eps", "a.png"])
def test_pictures_for_outside_programs_are_not_read(name: str, tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / name, "EPS")
    (tmp_path / "scan.glb").write_bytes(glb(*picture_tree(name)))
    (tmp_path / "scan.mtl").write_text(f"newmtl paint\nKd 0.2 0.4 0.6\nmap_Kd {name}\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    for file in ("scan.glb", "scan.obj"):
        scan = read_mesh(tmp_path / file)
        assert all(m.image is None for m in scan.materials), file
        assert any("picture" in w for w in scan.warnings), (file, scan.warnings)


def test_images_of_one_place_are_opened_once_and_within_the_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    png = base64.b64encode(picture_bytes(40, 40)).decode()
    tree, data = picture_tree(f"data:image/png;base64,{png}")
    tree["images"] *= 5
    tree["textures"] = [{"source": k} for k in range(5)]
    tree["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}} for k in range(5)
    ]
    one = tree["meshes"][0]["primitives"][0]
    tree["meshes"][0]["primitives"] = [{**one, "material": k} for k in range(5)]
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(tree, data))
    monkeypatch.setattr(images.PixelBudget.__init__, "__defaults__", (2000,))
    scan = read_mesh(path)
    assert len({id(m.image) for m in scan.materials}) == 1
    assert not scan.warnings
    monkeypatch.setattr(images.PixelBudget.__init__, "__defaults__", (1000,))
    scan = read_mesh(path)
    assert all(m.image is None for m in scan.materials)
    assert any("pixels in total" in w for w in scan.warnings)


@pytest.mark.parametrize("suffix", ["glb", "obj"])
def test_enormous_picture_is_scaled_down(suffix: str, tmp_path: Path) -> None:
    (tmp_path / "wide.png").write_bytes(big_png(30_000, 2_200))
    (tmp_path / "scan.glb").write_bytes(glb(*picture_tree("wide.png")))
    (tmp_path / "scan.mtl").write_text("newmtl paint\nmap_Kd wide.png\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    scan = read_mesh(tmp_path / f"scan.{suffix}")
    image = scan.materials[0].image
    assert image is not None
    assert 3000 < image.width <= 4096
    assert np.asarray(image)[5, 5].tolist() == [10, 200, 30]
    assert any("30000 × 2200 pixels scaled down" in w for w in scan.warnings)


@pytest.mark.parametrize("mode", ["RGB", "L", "RGBA", "P", "I;16"])
def test_shrinking_while_reading_is_the_mean(mode: str) -> None:
    rng = np.random.default_rng(0)
    smooth = rng.integers(0, 255, (13, 17, 3)).astype(np.uint8).repeat(3, 0).repeat(3, 1)
    image = Image.fromarray(smooth)
    if mode == "I;16":
        image = Image.fromarray(smooth[..., 0].astype(np.uint16) * 257)
    elif mode == "P":
        image = image.quantize(200)
    else:
        image = image.convert(mode)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    small = shrink_png(stream.getvalue(), 17)
    if mode == "I;16":
        truth = np.repeat(smooth[::3, ::3, :1], 3, axis=2)
    else:
        truth = np.asarray(image.convert("RGB"))[::3, ::3]
    assert small.shape == (13, 17, 3)
    assert np.abs(small.astype(int) - truth).max() <= 1


@pytest.mark.parametrize(
    "data",
    [
        SIGNATURE + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 2**30, 1, 8, 2, 0, 0, 0) + bytes(9),
        big_png(9000, 8000)[:5000],
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I4sIIBBBBB", 13, b"IHDR", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0),
        picture_bytes(64, 64, "JPEG")[:-500],
    ],
)
def test_decompression_bombs_and_truncated_images_are_left_out(data: bytes) -> None:
    warnings: list[str] = []
    image = images.open_image(data, "a", warnings, images.PixelBudget())
    found = images.decode_all({} if image is None else {"a": image}, warnings)
    assert found.get("a") is None
    assert warnings


def test_many_pictures_are_scaled_down_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(images, "MAX_TOTAL_PIXELS", 10_000)
    warnings: list[str] = []
    made = images.decode_all({str(k): Image.new("RGB", (100, 50)) for k in range(8)}, warnings)
    sizes = [i.width * i.height for i in made.values() if i is not None]
    assert len(sizes) == 8
    assert 8_000 < sum(sizes) <= 10_000
    assert "scaled down to 50 %" in warnings[0]


PLY = (
    "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
)
FACES = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("counts", [(4_000_000_000, 1), (3, 4_000_000_000), (-5, 1), (3, 2**63)])
def test_false_ply_headers_are_refused(kind: str, counts: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    head = PLY.format(kind, counts[0]) + FACES.format(counts[1])
    path.write_bytes(head.encode() + b"0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n")
    with pytest.raises(FileFormatError, match=r"declares|damaged PLY header"):
        read_scan(path)


def test_ply_header_without_end(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(b"ply\n" + b"comment x\n" * 100_000)
    with pytest.raises(FileFormatError, match="no PLY header"):
        read_header(path)


def test_stl_with_a_false_triangle_count_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50))
    with pytest.raises(FileFormatError, match="declares 4,000,000,000 triangles"):
        read_mesh(path)


def test_off_with_false_counts_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.off"
    path.write_text("OFF\n3 4000000000 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n")
    with pytest.raises(FileFormatError, match="declares"):
        read_mesh(path)


def test_off_with_comments(tmp_path: Path) -> None:
    path = tmp_path / "scan.off"
    path.write_text(
        "OFF\n# made 2026 by 4000000000 hands, 4000000000 0\n\n3 1 0 # counts\n"
        "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n"
    )
    assert len(read_mesh(path).faces) == 1


def test_obj_of_very_many_groups(tmp_path: Path) -> None:
    path = tmp_path / "scan.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\n" + "o a\nf 1 2 3\n" * 60_000)
    with pytest.raises(FileFormatError, match="60,000 groups"):
        read_mesh(path)


def test_a_hundred_thousand_loose_pieces_are_read(tmp_path: Path) -> None:
    count = 100_000
    corner = np.array([[0, 0, 0], [0.01, 0, 0], [0.01, 0.01, 0]])
    place = np.random.default_rng(0).uniform(0, 5, (count, 1, 3))
    mesh = trimesh.Trimesh(
        (place + corner).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False
    )
    mesh.export(str(tmp_path / "scan.ply"))
    assert len(read_scan(tmp_path / "scan.ply").faces) == count


def test_duplicated_faces_do_no_harm(tmp_path: Path) -> None:
    mesh = scans.sheet((0, 0), (2, 2), step=1.0)
    twice = trimesh.Trimesh(mesh.vertices, np.tile(mesh.faces, (3, 1)), process=False)
    twice.export(str(tmp_path / "scan.ply"))
    scan = read_scan(tmp_path / "scan.ply")
    check_sound(scan)


def test_obj_that_takes_its_materials_from_outside(tmp_path: Path) -> None:
    (tmp_path / "out.mtl").write_text("newmtl a\nKd 1 0 0\n")
    folder = tmp_path / "scan"
    folder.mkdir()
    (folder / "scan.obj").write_text(
        "mtllib ../out.mtl\nusemtl a\nv 0 0 0\nv 4 0 0\nv 4 0 3\nf 1 2 3\n"
    )
    scan = read_mesh(folder / "scan.obj")
    check_sound(scan)
    assert any("'../out.mtl' leaves the scan's folder" in w for w in scan.warnings)


@pytest.mark.parametrize(
    ("limit", "what"), [("MAX_HITS", "meet the vertical lines"), ("MAX_TESTS", "cells of 0.1 m")]
)
def test_endless_stacks_of_faces_are_refused(
    limit: str, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sheet = scans.sheet((0, 0), (2, 2))
    vertices = np.concatenate([sheet.vertices + np.array([0, 0, 0.1 * k]) for k in range(10)])
    faces = np.concatenate([sheet.faces + len(sheet.vertices) * k for k in range(10)])
    grid = GridSpec.covering(np.zeros(2), np.full(2, 2.0), 0.1)
    columns = sample_columns(vertices, faces, grid)
    assert len(columns.z) >= 10 * 400
    monkeypatch.setattr(columns_module, limit, 3999)
    with pytest.raises(SceneError, match=what):
        sample_columns(vertices, faces, grid)


SOUND = sound_files()


@pytest.mark.parametrize("suffix", [s for s in sorted(SOUND) if s not in ("pcd",)])
def test_undamaged_files_are_sound(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scan.{suffix}"
    path.write_bytes(SOUND[suffix])
    check_sound(read_here(path))


def read_here(path: Path) -> Scan:
    return scan_of(path, read_usd.read(path)) if path.suffix == ".usda" else read_mesh(path)


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
@pytest.mark.parametrize("suffix", [s for s in sorted(SOUND) if s != "pcd"])
def test_damaged_files_end_in_typed_errors(
    suffix: str, tmp_path: Path, data: st.DataObject
) -> None:
    raw = data.draw(damage(suffix, SOUND[suffix]))
    # USD keeps layers by name: each example needs its own.
    path = tmp_path / f"{zlib.crc32(raw):08x}.{suffix}"
    path.write_bytes(raw)
    try:
        scan = read_here(path)
    except InputError as error:
        assert "\n" not in str(error)
        return
    check_sound(scan)
