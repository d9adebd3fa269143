"""Counts and numbers of Gaussian splats that no honest file has, and honest ones far away."""

import json
import re
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

from tests.formats.splats.test_read import E, gltf_bytes, spz_bytes
from tests.security.hostile import refusal
from tests.support.scenes.splats import random_cloud
from vlnpe.formats.splats.ply import write_ply_splats
from vlnpe.formats.splats.read import read_splats
from vlnpe.formats.untrusted.glb import glb_bytes
from vlnpe.formats.untrusted.limits import VARIABLE
from vlnpe.scene_repair.splats.read import read_splat_scan

MAGIC = 0x5053474E
COUNT = 15_000_000  # with harmonics of degree 3 these take 3.5 GiB; without, 0.8 GiB


def gzip_bomb(version: int) -> bytes:
    head = struct.pack("<IIIBBBB", MAGIC, version, COUNT, 3, 12, 0, 0)
    packer = zlib.compressobj(9, zlib.DEFLATED, 16 + zlib.MAX_WBITS)
    block = bytes(1 << 20)
    return b"".join([packer.compress(head), *(packer.compress(block) for _ in range(8)),
                     packer.flush()])  # fmt: skip


def zstd_bomb() -> bytes:
    sizes = [9 * COUNT, COUNT, 3 * COUNT, 3 * COUNT, 4 * COUNT, 45 * COUNT]
    head = struct.pack("<IIIBBBBI", MAGIC, 4, COUNT, 3, 12, 0, 6, 32).ljust(32, b"\0")
    stream = zstandard.ZstdCompressor(19).compress(bytes(1 << 20))
    table = b"".join(struct.pack("<QQ", len(stream), size) for size in sizes)
    return head + table + stream * 6


def in_gltf(data: bytes) -> bytes:
    primitive = {
        "mode": 0,
        "attributes": {},
        "extensions": {E: {"extensions": {f"{E}_compression_spz_2": {"bufferView": 0}}}},
    }
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": [E],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
    }
    return glb_bytes(tree, data)


def shown_often(times: int) -> bytes:
    """One mesh of 20,000 splats of degree 1 at `times` nodes."""
    data = gltf_bytes(random_cloud(np.random.default_rng(0), 20_000, 1))
    return altered_gltf(data, lambda tree: tree.update(nodes=[{"mesh": 0}] * times, scenes=[]))


def altered_gltf(data: bytes, change) -> bytes:
    length = struct.unpack_from("<I", data, 12)[0]
    tree = json.loads(data[20 : 20 + length])
    change(tree)
    return glb_bytes(tree, data[28 + length :])


BOMBS = {
    "gzip.spz": gzip_bomb(2),
    "zstd.spz": zstd_bomb(),
    "gzip.glb": in_gltf(gzip_bomb(3)),
    "zstd.glb": in_gltf(zstd_bomb()),
    "nodes.glb": shown_often(3000),
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_fill_memory_is_refused_before_it_is_unpacked(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    path.write_bytes(BOMBS[name])

    def forbidden(*_: object) -> None:
        raise AssertionError("something was unpacked or built")

    monkeypatch.setattr("vlnpe.formats.splats.packed.GaussianCloud", forbidden)
    monkeypatch.setattr("vlnpe.formats.splats.gltf.GaussianCloud", forbidden)
    monkeypatch.setattr(zstandard, "ZstdDecompressor", forbidden)
    reason = refusal(lambda: read_splats(path)).reason
    assert "declares" in reason
    assert "20,000,000" in reason or "splat_bytes" in reason


def test_the_limit_follows_the_degree_and_can_be_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for degree in (0, 3):
        cloud = random_cloud(np.random.default_rng(0), 100, degree)
        (tmp_path / f"{degree}.spz").write_bytes(spz_bytes(cloud, 3))
    monkeypatch.setenv(VARIABLE, "splat_bytes=10000")
    assert len(read_splats(tmp_path / "0.spz")) == 100
    assert "limit splat_bytes" in refusal(lambda: read_splats(tmp_path / "3.spz")).reason
    monkeypatch.setenv(VARIABLE, "splat_bytes=30000")
    assert len(read_splats(tmp_path / "3.spz")) == 100


@pytest.mark.parametrize("value", [float("inf"), 1e300, -1, "many", None, [3]])
@pytest.mark.parametrize("key", ["count", "byteOffset"])
def test_strange_numbers_in_gltf_name_the_file(value: object, key: str, tmp_path: Path) -> None:
    data = gltf_bytes(random_cloud(np.random.default_rng(0), 10))
    path = tmp_path / "strange.glb"
    path.write_bytes(altered_gltf(data, lambda tree: tree["accessors"][0].update({key: value})))
    assert refusal(lambda: read_splats(path)).path == path


@pytest.mark.parametrize(("scale", "spread"), [(np.exp(13), 1.0), (0.01, 0.0), (1e-20, 1e-30)])
def test_splats_without_a_surface_name_the_file(
    scale: float, spread: float, tmp_path: Path
) -> None:
    position = spread * np.random.default_rng(0).normal(size=(2000, 3)).astype("f4")
    sizes = np.full((2000, 3), scale, "f4")
    cloud = random_cloud(np.random.default_rng(0), 2000)
    path = tmp_path / "odd.ply"
    write_ply_splats(path, replace(cloud, position=position, scale=sizes))
    error = refusal(lambda: read_splat_scan(path, lambda _: None))
    assert error.path == path
    assert "Gaussians" in error.reason


FAR = np.array([691607.53, 5335984.12, 519.3])


def test_splats_far_from_the_origin_keep_their_places(tmp_path: Path) -> None:
    """64-bit numbers in PLY, and a node's translation in glTF."""
    cloud = random_cloud(np.random.default_rng(0), 200, 1)
    near = cloud.position.astype(np.float64)
    write_ply_splats(tmp_path / "near.ply", cloud)
    data = (tmp_path / "near.ply").read_bytes()
    head, _, body = data.partition(b"end_header\n")
    names = [line.split()[-1] for line in head.decode().splitlines() if line.startswith("property")]
    rows = np.frombuffer(body, [(name, "<f4") for name in names])
    wide = np.zeros(len(rows), [(name, "<f8" if name in "xyz" else "<f4") for name in names])
    for name in names:
        wide[name] = rows[name] + (FAR["xyz".index(name)] if name in "xyz" else 0)
    text = re.sub("property float ([xyz])\n", "property double \\1\n", head.decode())
    (tmp_path / "far.ply").write_bytes(f"{text}end_header\n".encode() + wide.tobytes())
    (tmp_path / "far.glb").write_bytes(gltf_bytes(cloud, translation=FAR.tolist()))
    for name in ("far.ply", "far.glb"):
        read = read_splats(tmp_path / name)
        assert np.abs(read.position).max() < 1e4, name
        assert np.allclose(read.position + np.array(read.offset), near + FAR, atol=2e-3), name
        assert not read.warnings
        back = np.eye(4)
        back[:3, 3] = -FAR
        assert np.allclose(read.transformed(back).position, near, atol=2e-3)


def test_splats_rounded_by_32_bits_are_reported(tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(0), 200)
    moved = (cloud.position + FAR).astype(np.float32)
    write_ply_splats(tmp_path / "a.ply", replace(cloud, position=moved))
    read = read_splats(tmp_path / "a.ply")
    assert any("32-bit numbers, which lie 0.5 units apart" in text for text in read.warnings)
