"""One place decides what may be opened: `formats.untrusted`."""

import ast
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.security.hostile import refusal
from vlnpe.formats.core.errors import FileFormatError, first_line
from vlnpe.formats.splats.kind import is_splats, splat_kind
from vlnpe.formats.splats.ply_header import read_ply_header
from vlnpe.formats.splats.read import read_splats
from vlnpe.formats.splats.store import SPLATS_NAME, load_splats
from vlnpe.pipeline.stages.scenes.items import item
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.scan.dispatch import read_scan
from vlnpe.scene_repair.scan.files import SUFFIXES
from vlnpe.scene_repair.scan.headers import CHECKS, check_pcd
from vlnpe.scene_repair.scan.mesh import read_mesh
from vlnpe.scene_repair.splats.occupancy import read_occupancy
from vlnpe.scene_repair.splats.read import read_splat_scan
from vlnpe.scene_repair.usd.package import check_package, read_member

ROOT = Path(__file__).resolve().parents[2]
# Calls that open a file by its path, and would wait for a writer if it is a FIFO.
OPENERS = {"open", "read_bytes", "read_text", "fromfile", "memmap", "load", "ZipFile", "imread"}
# Files that the code wrote itself, and those of the installed package.
OWN = {
    "scene_repair/scan/readings.py",
    "scene_repair/scan/sandbox.py",
    "scene_repair/splats/usd.py",
    "scene_repair/verify/scene.py",
}


def path_openers(source: str) -> list[str]:
    """Return the calls in a module that open something named rather than an open stream."""
    calls = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        name = node.func.id if isinstance(node.func, ast.Name) else name
        text = ast.unparse(node)
        # An open stream is no name; PIL's and zipfile's `open` are given one here.
        streamed = any(word in text for word in ("stream", "BytesIO", "archive", "'w"))
        if name in OPENERS and not streamed and not text.startswith(("av.", "webbrowser.")):
            calls.append(text)
    return calls


@pytest.mark.parametrize("package", ["scene_repair", "formats/splats"])
def test_readers_open_no_path_themselves(package: str) -> None:
    found = {
        f"{path.relative_to(ROOT)}: {call}"
        for path in sorted((ROOT / package).rglob("*.py"))
        if path.relative_to(ROOT).as_posix() not in OWN
        for call in path_openers(path.read_text())
    }
    assert not {call for call in found if "sight.open(" not in call}


def test_the_search_finds_what_opens_a_path() -> None:
    for line in ('path.open("rb")', "Path(p).read_bytes()", "np.fromfile(p)", "ZipFile(path)"):
        assert path_openers(line)


@pytest.fixture
def alarm():
    """End a test that waits for a writer."""

    def ring(*_: object) -> None:
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, 20)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    **{f"repair {s}": (s, lambda p: item(p, p.parent / "out", RepairConfig())) for s in SUFFIXES},
    **{f"read_scan {s}": (s, read_scan) for s in SUFFIXES},
    **{f"check {s}": (s, check) for s, check in CHECKS.items()},
    **{f"splats {s}": (s, read_splats) for s in (".ply", ".splat", ".spz", ".glb", ".gltf")},
    "splat scan": (".ply", lambda p: read_splat_scan(p, lambda _: None)),
    "splat kind": (".ply", splat_kind),
    "splat kind of USD": (".usdc", splat_kind),
    "header": (".ply", read_ply_header),
    "mesh": (".stl", read_mesh),
    "points": (".pcd", check_pcd),
    "package": (".usdz", check_package),
    "member": (".usdz", lambda p: read_member(p, "a")),
    "map": (".png", lambda p: read_occupancy(p, None)),  # pyright: ignore[reportArgumentType]
}


@pytest.mark.usefixtures("alarm")
@pytest.mark.parametrize("name", READERS)
def test_no_reader_waits_for_a_fifo(name: str, tmp_path: Path) -> None:
    suffix, read = READERS[name]
    path = tmp_path / f"x{suffix}"
    os.mkfifo(path)
    assert "FIFO" in refusal(lambda: read(path)).reason


@pytest.mark.usefixtures("alarm")
def test_a_fifo_is_no_splats_and_no_part_of_a_scene(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.ply")
    assert not is_splats(tmp_path / "x.ply")
    os.mkfifo(tmp_path / SPLATS_NAME)
    with pytest.raises(FileFormatError):
        load_splats(tmp_path)


def test_no_message_carries_an_address(tmp_path: Path) -> None:
    """Not even one that a library makes: all warnings of a scan go through its record."""
    thing = repr(object())
    assert " at 0x" in thing
    assert "0x" not in str(FileFormatError(tmp_path / "a", f"no image in {thing}"))
    assert "0x" not in first_line(ValueError(f"no image in {thing}"))
    (tmp_path / "paint.png").write_bytes(b"no picture")
    (tmp_path / "scan.mtl").write_text("newmtl paint\nmap_Kd paint.png\n")
    (tmp_path / "scan.obj").write_text(
        "mtllib scan.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 3\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    scan = read_scan(tmp_path / "scan.obj")
    assert scan.warnings
    for warning in (*scan.warnings, *replace(scan, warnings=(thing,)).warnings):
        assert "0x" not in warning
