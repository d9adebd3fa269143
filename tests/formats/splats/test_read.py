"""Gaussian splats in every file format, against other readers and against each other."""

import contextlib
import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from tests.conftest import SHARED_SCENES
from tests.support.scenes.splats import assert_same, random_cloud
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.splats.harmonics import C0, basis
from vlnpe.formats.splats.kind import splat_kind
from vlnpe.formats.splats.ply import write_ply_splats
from vlnpe.formats.splats.read import read_splats
from vlnpe.formats.splats.record import GaussianCloud, covariances
from vlnpe.formats.untrusted.glb import glb_bytes

FILES = SHARED_SCENES / "splats"
shared = pytest.mark.skipif(not FILES.is_dir(), reason=f"no splat files in {FILES}")
E = "KHR_gaussian_splatting"


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_ply_of_every_degree(degree: int, tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(degree), 60, degree)
    path = tmp_path / "a.ply"
    write_ply_splats(path, cloud, ("License CC0",))
    assert splat_kind(path) == "PLY of 3D Gaussian splatting"
    read = read_splats(path)
    assert_same(read, cloud, 1e-5)
    assert read.licence == "CC0"
    # trimesh keeps the properties as the file names them: channel by channel for f_rest.
    raw = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
    each = (degree + 1) ** 2 - 1
    for channel in range(3):
        assert np.allclose(raw[f"f_dc_{channel}"].ravel(), cloud.harmonics[:, 0, channel])
        for k in range(each):
            column = raw[f"f_rest_{channel * each + k}"].ravel()
            assert np.allclose(column, cloud.harmonics[:, 1 + k, channel])


@pytest.mark.parametrize("name", ["f_rest_3", "f_rest_0", "opacity", "rot_2"])
def test_a_ply_without_one_of_its_properties_is_refused_by_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    write_ply_splats(path, random_cloud(np.random.default_rng(0), 4, 1))
    other = f"{name[:-1]}x".encode()
    path.write_bytes(path.read_bytes().replace(f"{name}\n".encode(), other + b"\n"))
    with pytest.raises(FileFormatError, match=f"lack the properties {name}$"):
        read_splats(path)


def test_ply_agrees_with_open3d(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    cloud = random_cloud(np.random.default_rng(0), 50, 1)
    write_ply_splats(tmp_path / "a.ply", cloud)
    other = open3d.t.io.read_point_cloud(str(tmp_path / "a.ply"))
    read = read_splats(tmp_path / "a.ply")
    assert np.allclose(other.point.positions.numpy(), read.position)
    assert np.allclose(other.point.scale.numpy(), read.scale, rtol=1e-4)
    assert np.allclose(other.point.rot.numpy(), read.quat_wxyz, atol=1e-5)
    opacity = 1 / (1 + np.exp(-other.point.opacity.numpy().ravel()))
    assert np.allclose(opacity, read.opacity, atol=1e-5)
    assert np.allclose(other.point.f_dc.numpy(), read.harmonics[:, 0], atol=1e-5)


def test_dot_splat(tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(1), 80)
    rgb = np.clip(0.5 + C0 * cloud.harmonics[:, 0], 0, 1)
    color = np.rint(255 * np.c_[rgb, cloud.opacity]).astype(np.uint8)
    turn = np.clip(np.rint(cloud.quat_wxyz * 128 + 128), 0, 255).astype(np.uint8)
    rows = [
        struct.pack("<6f", *p, *s) + c.tobytes() + q.tobytes()
        for p, s, c, q in zip(cloud.position, cloud.scale, color, turn, strict=True)
    ]
    (tmp_path / "a.splat").write_bytes(b"".join(rows))
    assert_same(read_splats(tmp_path / "a.splat"), cloud, 5e-3)


def spz_bytes(cloud: GaussianCloud, version: int) -> bytes:
    """Return an SPZ file as its documentation describes it."""
    whole = np.rint(cloud.position * 4096).astype("<i4")
    position = np.ascontiguousarray(whole)[..., None].view(np.uint8)[..., :3].tobytes()
    alpha = np.rint(cloud.opacity * 255).astype(np.uint8).tobytes()
    color = np.clip((cloud.harmonics[:, 0] * 0.15 + 0.5) * 255, 0, 255).astype(np.uint8)
    scale = np.rint((np.log(cloud.scale) + 10) * 16).astype(np.uint8)
    xyzw = np.roll(cloud.quat_wxyz, -1, axis=1)
    if version == 2:
        xyzw = xyzw * np.where(xyzw[:, 3:] < 0, -1, 1)
        rotation = np.rint((xyzw[:, :3] + 1) * 127.5).astype(np.uint8).tobytes()
    else:
        words = []
        for quat in xyzw:
            largest = int(np.argmax(np.abs(quat)))
            quat = quat * (-1 if quat[largest] < 0 else 1)
            word = largest
            for k in range(4):
                if k != largest:
                    size = round(511 * abs(float(quat[k])) / np.sqrt(0.5))
                    word = word << 10 | (512 if quat[k] < 0 else 0) | size
            words.append(word)
        rotation = np.array(words, dtype="<u4").tobytes()
    rest = np.clip(np.rint(cloud.harmonics[:, 1:] * 128 + 128), 0, 255).astype(np.uint8)
    head = struct.pack("<IIIBBBB", 0x5053474E, version, len(cloud), cloud.degree, 12, 1, 0)
    parts = (head, position, alpha, color.tobytes(), scale.tobytes(), rotation, rest.tobytes())
    return gzip.compress(b"".join(parts), mtime=0)


@pytest.mark.parametrize(("version", "degree"), [(2, 0), (2, 3), (3, 0), (3, 2)])
def test_spz(version: int, degree: int, tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(2), 90, degree)
    (tmp_path / "a.spz").write_bytes(spz_bytes(cloud, version))
    read = read_splats(tmp_path / "a.spz")
    assert read.antialiased
    assert read.up is not None and read.up[0] == "y"
    assert_same(read, cloud, 8e-3)


def gltf_bytes(cloud: GaussianCloud, **node: object) -> bytes:
    columns = {
        "POSITION": cloud.position,
        f"{E}:SCALE": cloud.scale,
        f"{E}:ROTATION": np.roll(cloud.quat_wxyz, -1, axis=1),
        f"{E}:OPACITY": cloud.opacity[:, None],
    }
    k = 0
    for band in range(cloud.degree + 1):
        for m in range(2 * band + 1):
            columns[f"{E}:SH_DEGREE_{band}_COEF_{m}"] = cloud.harmonics[:, k]
            k += 1
    body, views, accessors = b"", [], []
    for values in columns.values():
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": len(data)})
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[values.shape[1]]
        entry = {"bufferView": len(accessors), "componentType": 5126, "count": len(cloud)}
        accessors.append(entry | {"type": kind})
        body += data
    primitive = {
        "mode": 0,
        "attributes": {name: k for k, name in enumerate(columns)},
        "extensions": {E: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    tree = {
        "asset": {"version": "2.0"},
        "extensionsUsed": [E],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **node}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return glb_bytes(tree, body)


def test_gltf_moves_splats_as_its_nodes_say(tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(3), 70, 3)
    turn = [0.5, 0.5, 0.5, 0.5]
    moved = {"rotation": turn, "scale": [2, 2, 2], "translation": [1, 2, 3]}
    (tmp_path / "a.glb").write_bytes(gltf_bytes(cloud, **moved))
    assert splat_kind(tmp_path / "a.glb")
    read = read_splats(tmp_path / "a.glb")
    matrix = np.eye(4)
    matrix[:3, :3] = 2 * quat_to_matrix(turn)
    matrix[:3, 3] = 1, 2, 3
    assert_same(read, cloud.transformed(matrix), 1e-5)
    assert read.position == pytest.approx(2 * cloud.position[:, [2, 0, 1]] + (1, 2, 3), abs=1e-5)
    assert read.unit is not None and read.unit[0] == "m"


def test_harmonics_turn_with_their_splats() -> None:
    rng = np.random.default_rng(4)
    cloud = random_cloud(rng, 20, 3)
    rotation = quat_to_matrix(rng.standard_normal(4))
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    direction = rng.standard_normal((50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    before = np.einsum("dk,nkc->ndc", basis(direction, 3), cloud.harmonics)
    turned = cloud.transformed(matrix).harmonics
    after = np.einsum("dk,nkc->ndc", basis(direction @ rotation.T, 3), turned)
    assert after == pytest.approx(before, abs=1e-5)


@shared
def test_the_same_scene_in_two_formats_agrees() -> None:
    ply, spz = read_splats(FILES / "biker.compressed.ply"), read_splats(FILES / "biker.spz")
    assert len(ply) == len(spz) == 152_746
    # PLY of this origin has y down and z forward, SPZ has y up and z backward.
    half_turn = np.diag([1.0, -1.0, -1.0, 1.0])
    spz = spz.transformed(half_turn)
    distance, other = KDTree(spz.position).query(ply.position)
    assert np.quantile(distance, 0.99) < 3e-4
    spz = spz.take(other)
    first, second = covariances(ply), covariances(spz)
    apart = np.linalg.norm(first - second, axis=1) / np.linalg.norm(first, axis=1)
    assert np.quantile(apart, 0.99) < 0.07  # SPZ rounds sizes to steps of 6 %
    assert np.quantile(np.abs(ply.opacity - spz.opacity), 0.99) < 0.005
    assert np.quantile(C0 * np.abs(ply.harmonics - spz.harmonics), 0.99) < 0.006


@shared
def test_compressed_ply_is_distinguished_from_point_clouds() -> None:
    assert "compressed" in splat_kind(FILES / "guitar.compressed.ply")
    assert len(read_splats(FILES / "guitar.compressed.ply")) == 90_854


def ply_text(properties: str, faces: int = 0, count: int = 3) -> bytes:
    names = properties.split()
    lines = "".join(f"property float {name}\n" for name in names)
    face = f"element face {faces}\nproperty list uchar int vertex_indices\n" if faces else ""
    start = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    return f"{start}{lines}{face}end_header\n".encode() + bytes(4 * len(names) * count + 13 * faces)


@pytest.mark.parametrize(
    ("properties", "faces"),
    [
        ("x y z", 0),
        ("x y z red green blue alpha", 0),
        ("x y z nx ny nz opacity intensity", 0),
        ("x y z scale_0", 0),
        ("x y z red green blue", 1),
        ("x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3", 1),
    ],
)
def test_meshes_and_point_clouds_are_no_splats(properties: str, faces: int, tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply_text(properties, faces))
    assert splat_kind(path) == ""
    with pytest.raises(FileFormatError, match="no Gaussian splats"):
        read_splats(path)


def test_a_mesh_in_gltf_is_no_splats(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "a.glb")
    assert splat_kind(tmp_path / "a.glb") == ""


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("a.ply", ply_text("x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0"), "scale_2"),
        ("a.ply", ply_text("x y z f_dc_0 scale_0 rot_0", count=0), "lack the properties"),
        ("a.splat", b"\0" * 33, "multiple of 32"),
        ("a.splat", b"\0" * 64, "not positive"),
        ("a.splat", b"", "declares 0"),
        ("a.spz", b"hello", "SPZ"),
        ("a.spz", struct.pack("<IIIBBBB", 0x5053474E, 9, 1, 0, 12, 0, 0), "version 9"),
        ("a.spz", struct.pack("<IIIBBBB", 0x5053474E, 4, 1 << 31, 0, 12, 0, 5), "Gaussians"),
        (
            "a.spz",
            gzip.compress(struct.pack("<IIIBBBB", 0x5053474E, 3, 9, 7, 12, 0, 0), mtime=0),
            "degree",
        ),
        ("a.xyz", b"1 2 3", "valid:"),
    ],
)
def test_errors_name_the_reason(name: str, data: bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=reason) as caught:
        read_splats(path)
    assert caught.value.path == path


@pytest.mark.parametrize("name", ["a.ply", "a.splat", "a.spz", "a.glb", "b.spz"])
def test_cut_and_altered_files_raise_nothing_else(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    cloud = random_cloud(rng, 40, 0 if name == "a.splat" else 1)
    path = tmp_path / name
    if name == "a.ply":
        write_ply_splats(path, cloud)
    elif name == "a.glb":
        path.write_bytes(gltf_bytes(cloud))
    elif name == "a.splat":
        path.write_bytes(np.random.default_rng(0).bytes(1280))
    elif name == "b.spz":
        if not FILES.is_dir():
            pytest.skip(f"no splat files in {FILES}")
        path.write_bytes((FILES / "biker.spz").read_bytes())
    else:
        path.write_bytes(spz_bytes(cloud, 3))
    whole = path.read_bytes()
    for k in range(6 if name == "b.spz" else 60):
        data = bytearray(whole[: rng.integers(len(whole))] if k % 2 else whole)
        for _ in range(k % 4):
            if data:
                data[rng.integers(min(len(data), 400))] = rng.integers(256)
        path.write_bytes(data)
        with contextlib.suppress(FileFormatError):
            assert len(read_splats(path)) <= 160_000


def test_invalid_numbers_are_dropped_and_counted(tmp_path: Path) -> None:
    cloud = random_cloud(np.random.default_rng(6), 30)
    cloud.position[3] = np.nan
    cloud.scale[7] = np.inf
    write_ply_splats(tmp_path / "a.ply", cloud)
    read = read_splats(tmp_path / "a.ply")
    assert len(read) == 28
    assert "2 Gaussians" in read.warnings[0]
