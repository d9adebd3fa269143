"""OBJ and MTL: references, false indices, invalid numbers, endless statements."""

from pathlib import Path

import numpy as np
import pytest

from tests.security.hostile import not_files, put, refusal
from tests.security.scans import cases as scans
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.obj import without_bad_faces

SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"
SOUND = SQUARE + "f 1 2 3\n"


@not_files
def test_only_regular_files_are_read(kind: str, tmp_path: Path) -> None:
    scans.check_places(".obj", kind, tmp_path)


def test_names_and_links(tmp_path: Path) -> None:
    scans.check_names(SOUND.encode(), ".obj", tmp_path)
    scans.check_the_users_link(SOUND.encode(), ".obj", tmp_path)


def scan_of(folder: Path, text: str):
    (folder / "scan.obj").write_text(text)
    return read_scan(folder / "scan.obj")


@pytest.mark.parametrize(
    "face",
    [
        "f 2 3 99",
        "f 2 3 -99",
        "f 1 2 4 99",
        "f 2/1/1 3/1/1 99/1/1",
        "f 2 3 99999999999999999999999999",
        "f 2 3 99\r",
        "f 2 \\\n3 99",
    ],
)
def test_a_face_of_a_missing_vertex_is_dropped_alone(face: str, tmp_path: Path) -> None:
    scan = scan_of(tmp_path, f"{SOUND}{face}\nf 2 4 3\n")
    assert len(scan.faces) == 2
    assert any("1 faces with indices out of range" in w for w in scan.warnings)


def test_indices_that_count_back_or_forward_are_kept() -> None:
    text = b"f 1 2 5\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -3\nf -4 1 2\nv 1 1 0\nv 2 2 2\n#f 9 9 9\n"
    sound, dropped = without_bad_faces(text)
    assert dropped == 1
    assert sound == text.replace(b"f -4 1 2", b"")


@pytest.mark.parametrize(
    "bad", ["f a b c", "f", "f 1", "f 1 2", "f / / /", "f 0 1 2", "f 1.5 2 3", "f 1//"]
)
def test_other_damaged_faces_cost_no_others(bad: str, tmp_path: Path) -> None:
    try:
        scan = scan_of(tmp_path, f"{SOUND}{bad}\n")
    except Exception:
        refusal(lambda: scan_of(tmp_path, f"{SOUND}{bad}\n"))
    else:
        assert len(scan.faces) >= 1


def test_texture_coordinates_and_normals_out_of_range_are_harmless(tmp_path: Path) -> None:
    text = f"{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2/99/1 3/1/99\nf 2/-99/-99 3/1/1 4/1/1\n"
    assert len(scan_of(tmp_path, text).faces) == 2


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e30", "9" * 400])
def test_faces_with_non_finite_coordinates_are_dropped(number: str, tmp_path: Path) -> None:
    scan = scan_of(tmp_path, f"v {number} 0 0\n{SQUARE}f 2 3 4\nf 1 2 3\n")
    assert len(scan.faces) == 1
    assert np.isfinite(scan.vertices).all()


OUT = [
    "../a.mtl",
    "/etc/passwd",
    "linked.mtl",
    "folder/a.mtl",
    "http://127.0.0.1:9/a.mtl",
    "/dev/zero",
    "a\0.mtl",
]
MATERIAL = "newmtl m\nKd 1 0 0\nmap_Kd {}\n"


def with_links(folder: Path, name: str, data: bytes) -> Path:
    inside = scans.outside(folder, name, data)
    (inside / f"linked{Path(name).suffix}").symlink_to(folder / name)
    (inside / "folder").symlink_to(folder)
    return inside


@pytest.mark.parametrize("name", OUT)
def test_materials_outside_are_left_out(name: str, tmp_path: Path) -> None:
    inside = with_links(tmp_path, "a.mtl", b"newmtl m\nKd 1 0 0\n")
    scan = scan_of(inside, f"mtllib {name}\nusemtl m\n{SOUND}")
    assert scan.materials[0].base_color[:2] != (1.0, 0.0)


@pytest.mark.parametrize("name", [n.replace(".mtl", ".png") for n in OUT])
def test_pictures_outside_are_left_out(name: str, tmp_path: Path) -> None:
    inside = with_links(tmp_path, "a.png", scans.secret_picture())
    (inside / "m.mtl").write_text(MATERIAL.format(name))
    uv = "vt 0 0\nvt 1 0\nvt 0 1\n"
    scan = scan_of(inside, f"mtllib m.mtl\nusemtl m\n{SQUARE}{uv}f 1/1 2/2 3/3\n")
    assert not scans.shows_secret(scan)


@not_files
@pytest.mark.parametrize("name", ["m.mtl", "a.png"])
def test_side_files_must_be_files(name: str, kind: str, tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text(MATERIAL.format("a.png"))
    (tmp_path / name).unlink(missing_ok=True)
    put(kind, tmp_path / name)
    scan = scan_of(tmp_path, f"mtllib m.mtl\nusemtl m\n{SQUARE}vt 0 0\nf 1/1 2/1 3/1\n")
    assert len(scan.faces) == 1
    assert not scans.shows_secret(scan)


@pytest.mark.parametrize(
    "material",
    [
        "newmtl " + "x" * 100_000,
        "Kd 1 0 0",
        "newmtl m\nKd nan inf x\n",
        "newmtl m\nKd\n",
        "newmtl m\nmap_Kd\n",
        "newmtl m\n" * 10_000,
        "\xff\xfe\0\0",
        "newmtl m\nmtllib m.mtl\n",
    ],
)
def test_damaged_materials_leave_the_shape(material: str, tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text(material, "latin-1")
    try:
        assert len(scan_of(tmp_path, f"mtllib m.mtl\nusemtl m\n{SOUND}").faces) == 1
    except Exception:
        refusal(lambda: scan_of(tmp_path, f"mtllib m.mtl\nusemtl m\n{SOUND}"))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\0" * 1000,
        "f 1 2 3\n",
        SQUARE,
        SQUARE + "f " + "1 " * 200_000 + "\n",
        SQUARE + "f 1 2 3\\\n" * 10,
        "v " + "0 " * 100_000 + "\n" + SOUND,
        "mtllib scan.obj\n" + SQUARE,
    ],
)
def test_other_nonsense_ends_in_an_error_or_a_scan(text: str, tmp_path: Path) -> None:
    try:
        scan_of(tmp_path, text)
    except Exception:
        refusal(lambda: scan_of(tmp_path, text))
