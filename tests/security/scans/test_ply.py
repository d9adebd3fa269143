"""PLY: a texture's path, false headers, invalid numbers."""

import logging
from pathlib import Path

import pytest

from tests.security.hostile import not_files, put, refusal
from tests.security.scans import cases as scans
from vlnpe.scene_repair.scan.dispatch import read_scan

HEAD = """ply
format {format} 1.0
comment TextureFile {texture}
element vertex {vertices}
property float x
property float y
property float z
property float s
property float t
element face {faces}
property list uchar int vertex_indices
end_header
"""
ROWS = "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n{face}\n"


def ply(
    texture: str = "a.png",
    face: str = "3 0 1 2",
    vertices: str = "3",
    faces: str = "1",
    format: str = "ascii",
) -> bytes:
    head = HEAD.format(texture=texture, vertices=vertices, faces=faces, format=format)
    return (head + ROWS.format(face=face)).encode()


def scan_of(folder: Path, data: bytes):
    (folder / "scan.ply").write_bytes(data)
    return read_scan(folder / "scan.ply")


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    scans.check_places(".ply", kind, tmp_path)


def test_names_and_links(tmp_path: Path) -> None:
    scans.check_names(ply(), ".ply", tmp_path)
    scans.check_the_users_link(ply(), ".ply", tmp_path)


def test_a_texture_beside_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(scans.secret_picture())
    assert scans.shows_secret(scan_of(tmp_path, ply()))


@pytest.mark.parametrize(
    "texture",
    [
        "missing.png",
        "../a.png",
        "linked.png",
        "folder/a.png",
        "/etc/passwd",
        "/dev/zero",
        "http://127.0.0.1:9/a.png",
        "file:///etc/passwd",
        "x" * 10_000 + ".png",
        "",
        ".",
    ],
)
def test_textures_outside_are_left_out_and_nothing_is_logged(
    texture: str, tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture
) -> None:
    inside = scans.outside(tmp_path, "a.png", scans.secret_picture())
    (inside / "linked.png").symlink_to(tmp_path / "a.png")
    (inside / "folder").symlink_to(tmp_path)
    with caplog.at_level(logging.DEBUG):
        scan = scan_of(inside, ply(texture))
    assert not scans.shows_secret(scan)
    assert all(len(w) < 1000 for w in scan.warnings)
    assert "Traceback" not in caplog.text + capfd.readouterr().err


@not_files
def test_textures_must_be_files(kind: str, tmp_path: Path) -> None:
    put(kind, tmp_path / "a.png")
    assert not scans.shows_secret(scan_of(tmp_path, ply()))


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ("4000000000", "1"),
        ("3", "4000000000"),
        ("-3", "1"),
        ("3", "-1"),
        ("9" * 5000, "1"),
        ("x", "1"),
        ("3.5", "1"),
        ("", "1"),
    ],
)
@pytest.mark.parametrize("format", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_false_counts_are_refused(vertices: str, faces: str, format: str, tmp_path: Path) -> None:
    refusal(lambda: scan_of(tmp_path, ply(vertices=vertices, faces=faces, format=format)))


@pytest.mark.parametrize(
    "face",
    [
        "3 0 1 99",
        "3 0 1 -1",
        "300 0 1 2",
        "3 0 1",
        "0",
        "-1 0 1 2",
        "3 a b c",
        "",
        "3 0 1 99999999999",
    ],
)
def test_inconsistent_faces_are_dropped_or_refused(face: str, tmp_path: Path) -> None:
    try:
        scan = scan_of(tmp_path, ply(face=face))
    except Exception:
        refusal(lambda: scan_of(tmp_path, ply(face=face)))
    else:
        assert ((scan.faces >= 0) & (scan.faces < len(scan.vertices))).all()


def test_coloured_points_whose_faces_are_all_dropped_are_refused(tmp_path: Path) -> None:
    """Found by fuzzing."""
    data = ply(face="3 0 1 99").replace(
        b"float s\nproperty float t", b"uchar red\nproperty uchar green"
    )
    error = refusal(
        lambda: scan_of(tmp_path, data.replace(b"green", b"green\nproperty uchar blue"))
    )
    assert error.path == tmp_path / "scan.ply"


@pytest.mark.parametrize("number", ["nan", "inf", "1e400", "x"])
def test_non_finite_numbers_are_dropped_or_refused(number: str, tmp_path: Path) -> None:
    refusal(
        lambda: scan_of(tmp_path, ply().replace(b"\n1 0 0 1 0", f"\n{number} 0 0 1 0".encode()))
    )


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"ply",
        b"ply\nend_header\n",
        b"ply\n" + b"comment x\n" * 20_000 + b"end_header\n",
        b"ply\nformat ascii 1.0\n"
        + b"element face 1\nproperty list uchar int a\n" * 500
        + b"end_header\n",
        b"ply\nformat ascii 1.0\nproperty float x\nend_header\n",
    ],
)
def test_invalid_headers_are_refused(data: bytes, tmp_path: Path) -> None:
    refusal(lambda: scan_of(tmp_path, data))
