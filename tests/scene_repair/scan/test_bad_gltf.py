"""Reading inconsistent and hostile glTF."""

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.support.scenes.damage import picture_bytes
from tests.support.scenes.small_glb import check_sound, glb, picture_tree, triangle_tree
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.scene_repair.gltf import checks as gltf_check
from vlnpe.scene_repair.gltf.file import GltfFile
from vlnpe.scene_repair.scan.mesh import _load, _parts, read_mesh
from vlnpe.scene_repair.scan.record import Scan
from vlnpe.scene_repair.scan.resolver import ConfinedResolver

pytestmark = pytest.mark.chain


def test_handmade_triangle_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "scan.glb"
    path.write_bytes(glb(*triangle_tree()))
    scan = read_mesh(path)
    check_sound(scan)
    assert len(scan.faces) == 1


def points(count: float, **more: Any) -> dict[str, Any]:
    return {"componentType": 5126, "count": count, "type": "VEC3", **more}


def buffer(uri: str) -> dict[str, Any]:
    return {"buffers": [{"byteLength": 42, "uri": uri}]}


DRACO = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {}}}
PACKED = {"attributes": {"POSITION": 0}, "indices": 1, "extensions": DRACO}
VIEW = {"buffer": 0, "byteLength": 36}
OUT = "leads out of the scan's folder"


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"accessors": [points(4_000_000_000, bufferView=0)]}, "4,000,000,000 elements"),
        ({"accessors": [points(4_000_000_000)]}, "without data"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 10**9}]}, "1,000,000,000 of"),
        ({"bufferViews": [{**VIEW, "byteOffset": float("inf")}]}, "OverflowError"),
        ({"accessors": [points(1e999, bufferView=0)]}, "OverflowError"),
        ({"accessors": [points(6_000_000)] * 2}, "12,000,000 elements without data"),
        (buffer("../x.bin"), OUT),
        (buffer("/etc/hostname"), OUT),
        (buffer("http://x.test/a.bin"), OUT),
        (buffer("%2e%2e/x.bin"), OUT),
        (buffer("none.bin"), "missing"),
        (buffer("data:,!!!"), "base64"),
        ({"nodes": [{"mesh": 0, "children": [1]}, {"children": [0]}]}, "its own ancestor"),
        ({"nodes": [{"mesh": 7}]}, "mesh 7; there are 1"),
        ({"nodes": [{"mesh": 0, "children": [9]}]}, "node 9 does not exist; there are 1"),
        ({"nodes": [{"mesh": 0}] * 60_000, "scenes": [{"nodes": list(range(60_000))}]}, "60,000"),
        ({"nodes": [{"children": [k + 1]} for k in range(2000)] + [{"mesh": 0}]}, "deep"),
        ({"materials": True}, "not a list of objects"),
        ({"asset": {"version": "1.0"}}, "valid: 2"),
        ({"meshes": [{"primitives": [PACKED]}]}, "Draco"),
        ({"bufferViews": [{**VIEW, "extensions": {"EXT_meshopt_compression": {}}}]}, "meshopt"),
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


def read_transformed(folder: Path, transform: dict[str, Any]) -> Scan:
    png = base64.b64encode(picture_bytes(4, 4)).decode()
    tree, data = picture_tree(f"data:image/png;base64,{png}")
    info = tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"] = {"KHR_texture_transform": transform}
    (folder / "scan.glb").write_bytes(glb(tree, data))
    return read_mesh(folder / "scan.glb")


@pytest.mark.parametrize("rotation", [10**400, float("inf"), float("nan"), "a"])
def test_impossible_texture_transforms_leave_the_colour(rotation: Any, tmp_path: Path) -> None:
    scan = read_transformed(tmp_path, {"rotation": rotation})
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


def test_texture_transform_is_applied(tmp_path: Path) -> None:
    scan = read_transformed(tmp_path, {"offset": [0.5, 0.25], "scale": [2, 4]})
    assert scan.materials[0].name == "paint"
    assert scan.materials[0].image is not None
    # Written v down: (0, 0), (1, 0), (1, 1).
    down = scan.corner_uv[0] * (1, -1) + (0, 1)
    assert sorted(map(tuple, np.round(down, 5).tolist())) == [(0.5, 0.25), (2.5, 0.25), (2.5, 4.25)]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("../secret.png", "leads out of the scan's folder"),
        ("/etc/hostname", "leads out of the scan's folder"),
        ("http://x.test/a.png", "leads out of the scan's folder"),
        ("link.png", "leads out of the scan's folder"),
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
