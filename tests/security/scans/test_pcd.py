"""PCD: false headers; more of them in tests/scene_repair/scan/test_read_points.py."""

import struct
from pathlib import Path

import pytest

from tests.security.hostile import not_files, refusal
from tests.security.scans import cases as scans
from tests.support.scenes.damage import PCD
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.headers import check_pcd

POINTS = struct.pack("<16f", *range(16))


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    scans.check_places(".pcd", kind, tmp_path)


def test_a_sparse_file_of_a_terabyte_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "a.pcd").open("wb") as stream:
        stream.truncate(1 << 40)
    assert "too large" in refusal(lambda: read_scan(tmp_path / "a.pcd")).reason


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"WIDTH 4", b"WIDTH 4000000000"),
        (b"POINTS 4", b"POINTS 4000000000"),
        (b"POINTS 4", b"POINTS -4"),
        (b"POINTS 4", b"POINTS " + b"9" * 5000),
        (b"WIDTH 4", b"WIDTH nan"),
        (b"HEIGHT 1", b"HEIGHT 1e9"),
        (b"COUNT 1 1 1 1", b"COUNT 1 1 1 100000"),
        (b"COUNT 1 1 1 1", b"COUNT 1 1"),
        (b"SIZE 4 4 4 4", b"SIZE 4 4 4 -4"),
        (b"SIZE 4 4 4 4", b"SIZE 4 4 4 3"),
        (b"TYPE F F F F", b"TYPE F"),
        (b"FIELDS x y z rgb", b"FIELDS x y w rgb"),
        (b"FIELDS x y z rgb", b"FIELDS " + b"x" * 20_000),
        (b"DATA binary", b"DATA ../x"),
        (b"DATA binary", b"DATA"),
        (b"DATA binary\n", b"DATA binary_compressed\n" + struct.pack("<II", 5, 2**32 - 1)),
        (b"DATA binary\n", b"DATA binary_compressed\n" + struct.pack("<II", 2**32 - 1, 64)),
        (b"DATA binary\n", b""),
        (PCD, b""),
        (PCD, b"# comment\n" * 5000),
    ],
)
def test_false_headers_are_refused(old: bytes, new: bytes, tmp_path: Path) -> None:
    assert old in PCD
    path = tmp_path / "a.pcd"
    path.write_bytes(PCD.replace(old, new, 1) + POINTS)
    refusal(lambda: check_pcd(path))


def test_the_sound_header_passes(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_bytes(PCD + POINTS)
    check_pcd(tmp_path / "a.pcd")
