"""Reading damaged and malicious scan files: headers, pieces, any damaged byte."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.scenes import scans
from tests.support.scenes.damage import damage, sound_files
from tests.support.scenes.small_glb import check_sound
from vlnpe.formats.core.errors import FileFormatError, InputError, SceneError
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.scene_repair.grid import columns as columns_module
from vlnpe.scene_repair.grid.columns import sample_columns
from vlnpe.scene_repair.scan.dispatch import read_scan, scan_of
from vlnpe.scene_repair.scan.mesh import read_mesh
from vlnpe.scene_repair.scan.record import Scan
from vlnpe.scene_repair.usd import read_stage as read_usd

pytestmark = pytest.mark.chain
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


FALSE = {
    "a.stl": (
        bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50),
        "declares 4,000,000,000 tri",
    ),
    "a.off": (b"OFF\n3 4000000000 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n", "declares"),
    "a.obj": (b"v 0 0 0\nv 1 0 0\nv 1 1 0\n" + b"o a\nf 1 2 3\n" * 60_000, "60,000 groups"),
    "a.ply": (b"ply\n" + b"comment x\n" * 100_000, "no PLY header"),
}


@pytest.mark.parametrize("name", FALSE)
def test_false_headers_are_refused(name: str, tmp_path: Path) -> None:
    data, message = FALSE[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileFormatError, match=message):
        read_mesh(tmp_path / name)


def test_off_with_comments(tmp_path: Path) -> None:
    path = tmp_path / "scan.off"
    path.write_text(
        "OFF\n# made 2026 by 4000000000 hands, 4000000000 0\n\n3 1 0 # counts\n"
        "0 0 0\n1 0 0\n1 1 0\n3 0 1 2\n"
    )
    assert len(read_mesh(path).faces) == 1


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
    assert any("'../out.mtl' leads out of the scan's folder" in w for w in scan.warnings)


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
