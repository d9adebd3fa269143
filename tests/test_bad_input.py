"""Bad input: one clear line, exit code 2, nothing half-written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> Path:
    mesh.export(path)
    return path


def room(scale: float, floor: bool = True) -> trimesh.Trimesh:
    """A closed 6 × 5 × 3 m room seen from inside, or four walls standing on nothing."""
    box = trimesh.creation.box((6.0, 3.0, 5.0))  # y up, as glTF demands
    box.invert()
    if not floor:
        box.update_faces(np.abs(box.face_normals[:, 1]) < 0.5)
    box.apply_scale(scale)
    return box


def missing(folder: Path) -> Path:
    return folder / "nowhere.glb"


def no_mesh(folder: Path) -> Path:
    path = folder / "poem.glb"
    path.write_text("Two roads diverged in a yellow wood")
    return path


def truncated(folder: Path) -> Path:
    path = write_mesh(folder / "cut.glb", room(1.0))
    path.write_bytes(path.read_bytes()[:200])
    return path


def empty(folder: Path) -> Path:
    path = folder / "empty.ply"
    header = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
    header += (
        "property float z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path.write_text(header)
    return path


SCENES = {
    "missing": (missing, "nowhere.glb"),
    "no mesh": (no_mesh, "poem.glb"),
    "truncated": (truncated, "cut.glb"),
    "empty": (empty, "empty.ply"),
    "no floor": (lambda f: write_mesh(f / "walls.glb", room(1.0, floor=False)), "floor"),
    "50 mm": (lambda f: write_mesh(f / "doll.glb", room(0.05 / 6)), "50 mm"),
    "5 km": (lambda f: write_mesh(f / "city.glb", room(5000 / 6)), "5 km"),
    "unknown suffix": (
        lambda f: (f / "scan.xyz123").write_text("x") and f / "scan.xyz123",
        "xyz123",
    ),
}


def collect(cwd: Path, *options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vlnpe.pipeline.cli", "collect", *map(str, options)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)


def assert_refused(done: subprocess.CompletedProcess[str], says: str) -> None:
    assert done.returncode == 2, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("vlnpe: error: ")]
    assert len(lines) == 1, done.stderr
    assert says in lines[0]
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("case", SCENES)
def test_a_scene_that_is_none(tmp_path, case):
    make, says = SCENES[case]
    done = collect(tmp_path, "--scene", make(tmp_path), "--out", tmp_path / "run")
    assert_refused(done, says)
    left = [p for p in (tmp_path / "run").rglob("*") if p.is_file()]
    assert {p.name for p in left} <= {"manifest.json", "quarantine.json"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--robot", "aliengoo"), "aliengo"),
        (("--controller", "telepathy"), "path"),
        (("--camera", "rear"), "ego"),
        (("--light", "disco"), "baked"),
        (("--episodes", "0"), "EPISODES=0"),
        (("--episodes", "none.json.gz"), "none.json.gz"),
        (("--scenes", "nowhere"), "nowhere"),
        (("--frames-per-second", "7"), "25"),
        (("--workers", "-1"), "WORKERS=-1"),
    ],
)
def test_an_option_that_is_none_names_what_is_valid(tmp_path, options, says):
    assert_refused(collect(tmp_path, *options, "--out", tmp_path / "run"), says)
    assert not (tmp_path / "run").exists()


def test_an_output_folder_that_is_a_file(tmp_path):
    (tmp_path / "run").write_text("mine")
    assert_refused(collect(tmp_path, "--out", tmp_path / "run"), "run")
    assert (tmp_path / "run").read_text() == "mine"


def test_a_folder_where_nobody_can_write(tmp_path):
    # /proc refuses everybody, root too, which a folder's mode bits would not.
    assert_refused(collect(tmp_path, "--out", "/proc/run"), "not writable")
