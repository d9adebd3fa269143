"""Point clouds become surfaces: PLY without faces, PCD in its three kinds, and damaged ones."""

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.support.scenes import scans
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.orient.transform import orient
from vlnpe.scene_repair.scan import point_cloud as read_points
from vlnpe.scene_repair.scan.dispatch import read_scan, scan_of
from vlnpe.scene_repair.scan.headers import check_pcd

SIZE = (5.0, 4.0, 2.6)
needs_open3d = pytest.mark.usefixtures("open3d_loads")


@pytest.fixture
def open3d_loads() -> None:
    """Skip where the extra `scan`, or one of the system's libraries that it needs, is missing."""
    pytest.importorskip("open3d", exc_type=ImportError)


def cloud(spacing: float = 0.06) -> tuple[np.ndarray, np.ndarray]:
    """Points of a room as a scanner in its middle sees them, with 3 mm noise, and colours."""
    table = scans.box((1.0, 1.0, 0.0), (2.2, 1.8, 0.75))
    shell = scans.box((0, 0, 0), SIZE)
    both = scans.joined([shell, table])
    rng = np.random.default_rng(0)
    sampled: Any = trimesh.sample.sample_surface(both, int(both.area / spacing**2), seed=0)
    points, faces = sampled
    colors = np.where(both.face_normals[faces][:, 2:3] > 0.5, (0.8, 0.2, 0.2), (0.3, 0.4, 0.6))
    # What stands on the floor hides it.
    hidden = np.all((points >= (1.0, 1.0, -1)) & (points <= (2.2, 1.8, 1e-6)), axis=1)
    points = points + rng.normal(scale=0.003, size=points.shape)
    return points[~hidden], colors[~hidden]


def write_pcd(path: Path, points: np.ndarray, colors: np.ndarray, kind: str) -> None:
    import open3d as o3d

    made = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    made.colors = o3d.utility.Vector3dVector(colors)
    o3d.io.write_point_cloud(
        path, made, write_ascii=kind == "ascii", compressed=kind == "binary_compressed"
    )


@needs_open3d
def test_room_is_rebuilt_from_points_alone(tmp_path: Path) -> None:
    points, colors = cloud()
    path = tmp_path / "scan.ply"
    trimesh.PointCloud(points, colors=(255 * colors).astype(np.uint8)).export(str(path))
    scan = read_scan(path)
    way = orient(scan, RepairConfig())
    assert (way.evidence["up"], way.evidence["unit"]) == ("z", "m")
    assert way.evidence["extent_m"] == pytest.approx(SIZE, abs=0.08)
    corners = scan.vertices[scan.faces]
    center = corners.mean(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2
    # Middle of the floor: level with the truth, facing up, in its colour.
    floor = (np.abs(center[:, 2]) < 0.3) & np.all(np.abs(center[:, :2] - (3.8, 2.8)) < 0.8, axis=1)
    assert area[floor].sum() == pytest.approx(1.6 * 1.6, rel=0.05)
    assert np.abs(center[floor][:, 2]).max() < 0.02
    assert (normal[floor][:, 2] > 0).all()
    image = scan.materials[0].image
    assert image is not None
    x = (scan.corner_uv[floor][..., 0] * image.width).astype(int)
    y = ((1 - scan.corner_uv[floor][..., 1]) * image.height).astype(int)
    assert np.median(np.asarray(image)[y, x].reshape(-1, 3), axis=0) == pytest.approx(
        (76, 102, 153), abs=3
    )
    # The table's top is there too, and nothing is made up outside the room.
    top = (np.abs(center[:, 2] - 0.75) < 0.02) & (np.abs(center[:, :2] - (1.6, 1.4)) < 0.5).all(1)
    assert area[top].sum() == pytest.approx(1.0 * 0.8, rel=0.15)
    assert np.all(center > -0.1)
    assert np.all(center < np.add(SIZE, 0.1))


@needs_open3d
@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_every_kind_gives_the_same_surface(kind: str, tmp_path: Path) -> None:
    points, colors = cloud(0.15)
    write_pcd(tmp_path / "scan.pcd", points, colors, kind)
    first = scan_of(tmp_path / "scan.pcd", read_points.read(tmp_path / "scan.pcd"))
    again = scan_of(tmp_path / "scan.pcd", read_points.read(tmp_path / "scan.pcd"))
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.faces, again.faces)
    assert np.ptp(first.vertices, axis=0) == pytest.approx(SIZE, abs=0.3)
    assert first.materials[0].image is not None


@needs_open3d
def test_unseen_places_stay_open(tmp_path: Path) -> None:
    points, colors = cloud(0.1)
    hole = np.linalg.norm(points - (3.5, 2.5, 0.0), axis=1) < 0.9
    path = tmp_path / "scan.ply"
    trimesh.PointCloud(points[~hole], colors=(255 * colors[~hole]).astype(np.uint8)).export(
        str(path)
    )
    scan = scan_of(path, read_points.read(path))
    center = scan.vertices[scan.faces].mean(axis=1)
    assert (np.linalg.norm(center - (3.5, 2.5, 0.0), axis=1) > 0.35).all()


@needs_open3d
def test_invalid_points_are_dropped(tmp_path: Path) -> None:
    points, colors = cloud(0.15)
    points[::50] = np.nan
    points[1::50, 0] = 1e30
    write_pcd(tmp_path / "scan.pcd", points, colors, "binary")
    scan = scan_of(tmp_path / "scan.pcd", read_points.read(tmp_path / "scan.pcd"))
    assert np.ptp(scan.vertices, axis=0) == pytest.approx(SIZE, abs=0.3)
    assert any("invalid coordinates" in w for w in scan.warnings)


@needs_open3d
def test_too_few_points(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    trimesh.PointCloud(np.eye(3)).export(str(path))
    with pytest.raises(FileFormatError, match=r"scan\.ply: contains 3 usable points"):
        read_points.read(path)


def test_missing_open3d_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scan.ply"
    trimesh.PointCloud(cloud(0.5)[0]).export(str(path))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"extra `scan`"):
        read_points.read(path)


def test_open3d_without_its_system_libraries_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "scan.ply"
    trimesh.PointCloud(cloud(0.5)[0]).export(str(path))
    (tmp_path / "fake" / "open3d").mkdir(parents=True)
    (tmp_path / "fake" / "open3d" / "__init__.py").write_text(
        "raise OSError('libGL.so.1: cannot open shared object file')"
    )
    monkeypatch.syspath_prepend(str(tmp_path / "fake"))
    for name in [n for n in sys.modules if n.split(".")[0] == "open3d"]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(InputError, match=r"libGL\.so\.1.*apt-get install .*libgl1"):
        read_points.read(path)


HEAD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "no PCD header"),
        ("hello\nworld\n", "no PCD header"),
        ("VERSION .7\nFIELDS a\nDATA ascii\n", "damaged PCD header"),
        (HEAD.replace("x y z", "a b c") + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n", "x y z"),
        (HEAD + "WIDTH 4000000000\nHEIGHT 1\nPOINTS 4000000000\nDATA binary\n", "declares"),
        (HEAD + "WIDTH 1000000\nHEIGHT 1\nPOINTS 1000000\nDATA binary\n", "declares 1,000,000"),
        (HEAD + "WIDTH 10\nHEIGHT 1\nPOINTS 1000\nDATA ascii\n", "by width and height"),
        (HEAD + "WIDTH 9\nHEIGHT 1\nPOINTS 9\nDATA binary_compressed\n\xff\xff\xff\x7f", "unpacks"),
        (HEAD + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA zip\n", "unknown PCD data"),
        (HEAD.replace("4 4 4", "4 4 3") + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n", "SIZE"),
    ],
)
def test_false_pcd_headers_are_refused(text: str, what: str, tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(FileFormatError, match=what) as caught:
        check_pcd(path)
    assert caught.value.path == path
