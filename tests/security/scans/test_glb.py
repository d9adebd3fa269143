"""GLB and glTF: references, data: URIs, false sizes, cycles, recursion, NaN.

More false accessors, buffers and pictures are in tests/scene_repair/scan/test_bad_gltf.py.
"""

import base64
import json
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from tests.security.hostile import CLOSED_DEEP_JSON, DEEP_JSON, not_files, refusal
from tests.security.scans import cases as scans
from tests.support.scenes.damage import sound_files
from vlnpe.formats.untrusted.glb import glb_bytes
from vlnpe.scene_repair.scan.dispatch import read_scan

GLB = sound_files()["glb"]
POINTS = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@not_files
def test_only_regular_files_are_read(kind: str, suffix: str, tmp_path: Path) -> None:
    scans.check_places(suffix, kind, tmp_path)


def test_names_and_links(tmp_path: Path) -> None:
    scans.check_names(GLB, ".glb", tmp_path)
    scans.check_the_users_link(GLB, ".glb", tmp_path)


def tree(**changes: Any) -> dict[str, Any]:
    """One triangle."""
    return {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": "points.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    } | changes


def written(folder: Path, value: Any) -> Path:
    path = folder / "scan.gltf"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return path


def test_the_sound_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "points.bin").write_bytes(POINTS)
    assert len(read_scan(written(tmp_path, tree())).faces) == 1


OUT = [
    "../points.bin",
    "%2e%2e/points.bin",
    "..%2Fpoints.bin",
    "sub/../../points.bin",
    "linked.bin",
    "folder/points.bin",
    "http://127.0.0.1:9/points.bin",
    "https://host/points.bin",
    "file:///etc/passwd",
    "/etc/passwd",
    "/dev/zero",
    "//host/share",
    "points\0.bin",
    "x" * 5000,
]


@pytest.mark.parametrize("uri", OUT)
def test_buffers_outside_are_refused(uri: str, tmp_path: Path) -> None:
    inside = scans.outside(tmp_path, "points.bin", POINTS)
    (inside / "linked.bin").symlink_to(tmp_path / "points.bin")
    (inside / "folder").symlink_to(tmp_path)
    path = written(inside, tree(buffers=[{"byteLength": 36, "uri": uri}]))
    refusal(lambda: read_scan(path))


@pytest.mark.parametrize("uri", OUT)
def test_pictures_outside_are_left_out(uri: str, tmp_path: Path) -> None:
    inside = scans.outside(tmp_path, "points.bin", scans.secret_picture())
    (inside / "linked.bin").symlink_to(tmp_path / "points.bin")
    (inside / "folder").symlink_to(tmp_path)
    (inside / "data.bin").write_bytes(POINTS)
    look = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    value = tree(
        buffers=[{"byteLength": 36, "uri": "data.bin"}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        materials=[look],
        textures=[{"source": 0}],
        images=[{"uri": uri}],
    )
    scan = read_scan(written(inside, value))
    assert not scans.shows_secret(scan)
    assert scan.warnings


@not_files
def test_buffers_must_be_files(kind: str, tmp_path: Path) -> None:
    from tests.security.hostile import put

    put(kind, tmp_path / "points.bin")
    refusal(lambda: read_scan(written(tmp_path, tree())))


@pytest.mark.parametrize(
    "uri",
    [
        "data:application/octet-stream;base64,????",
        "data:,",
        "data:",
        "data:application/octet-stream;base64," + base64.b64encode(POINTS[:20]).decode(),
    ],
)
def test_invalid_embedded_data_is_refused(uri: str, tmp_path: Path) -> None:
    refusal(lambda: read_scan(written(tmp_path, tree(buffers=[{"byteLength": 36, "uri": uri}]))))


def test_gigabytes_of_embedded_data_are_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "scan.gltf"
    with path.open("wb") as stream:
        stream.truncate(900 << 20)
    tracemalloc.start()
    try:
        assert "data: URIs" in refusal(lambda: read_scan(path)).reason
        assert tracemalloc.get_traced_memory()[1] < 50 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "text",
    [
        DEEP_JSON,
        json.dumps(tree()).replace('"scenes"', f'"extras": {CLOSED_DEEP_JSON}, "scenes"'),
        "9" * 5000,
        "[]",
        "\0",
        json.dumps(tree(asset=5)),
        json.dumps(tree(asset={"version": "1.0"})),
        json.dumps(tree(nodes=5)),
        json.dumps(tree(nodes=[5])),
        json.dumps(tree(nodes=[{"mesh": 0, "children": [0]}])),
        json.dumps(tree(nodes=[{"children": [1]}, {"children": [0]}])),
        json.dumps(tree(nodes=[{"children": [k + 1]} for k in range(600)] + [{"mesh": 0}])),
        json.dumps(tree(nodes=[{"mesh": 7}])),
        json.dumps(tree(nodes=[{"mesh": 10**400}])),
        json.dumps(
            tree(
                accessors=[{"bufferView": 0, "componentType": 5126, "count": 1e999, "type": "VEC3"}]
            )
        ),
        json.dumps(tree(accessors=[{"componentType": 5126, "count": 10**10, "type": "VEC3"}])),
        json.dumps(tree(bufferViews=[{"buffer": 0, "byteLength": 10**18}])),
        json.dumps(tree(buffers=[{"byteLength": 10**18}])),
    ],
)
def test_false_headers_are_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "points.bin").write_bytes(POINTS)
    refusal(lambda: read_scan(written(tmp_path, text)))


def test_headers_of_very_many_values_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VLNPE_LIMITS", "json_values=10000 json_bytes=100000")
    path = tmp_path / "scan.glb"
    path.write_bytes(glb_bytes(tree(extras=[[]] * 20_000), POINTS))
    assert "values" in refusal(lambda: read_scan(path)).reason
    path.write_bytes(glb_bytes(tree(extras="x" * 200_000), POINTS))
    assert "bytes of JSON" in refusal(lambda: read_scan(path)).reason


def test_faces_with_non_finite_coordinates_are_dropped(tmp_path: Path) -> None:
    nan = struct.pack("<9f", *[float("nan"), 0, 0, 1, 0, 0, 0, float("inf"), 0])
    (tmp_path / "points.bin").write_bytes(nan)
    assert "invalid coordinates" in refusal(lambda: read_scan(written(tmp_path, tree()))).reason


@pytest.mark.parametrize("size", [0, 3, 11, 12, 19, 20, 100])
def test_cut_containers_are_refused(size: int, tmp_path: Path) -> None:
    (tmp_path / "scan.glb").write_bytes(GLB[:size])
    refusal(lambda: read_scan(tmp_path / "scan.glb"))


@pytest.mark.parametrize("at", [8, 12])
def test_containers_with_false_lengths(at: int, tmp_path: Path) -> None:
    data = bytearray(GLB)
    data[at : at + 4] = struct.pack("<I", 2**32 - 1)
    (tmp_path / "scan.glb").write_bytes(data)
    if at == 12:
        refusal(lambda: read_scan(tmp_path / "scan.glb"))
    else:
        assert len(read_scan(tmp_path / "scan.glb").faces)
