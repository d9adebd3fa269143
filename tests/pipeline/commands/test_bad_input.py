"""Bad input: one clear line, exit code 2, nothing half-written."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vlnpe.pipeline.cli import main

pytestmark = [pytest.mark.chain, pytest.mark.usefixtures("inline")]


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


@pytest.fixture
def refused(capsys, monkeypatch, tmp_path):
    """Return a function that runs `vlnpe collect` and requires one error line and exit code 2."""
    monkeypatch.chdir(tmp_path)

    def run(says: str, *options: object) -> None:
        code = main(["collect", *map(str, options)])
        error = capsys.readouterr().err
        lines = [line for line in error.splitlines() if line.startswith("vlnpe: error: ")]
        assert (code, len(lines)) == (2, 1), error
        assert says in lines[0]
        assert "Traceback" not in error

    return run


@pytest.mark.parametrize("case", SCENES)
def test_invalid_scenes_are_refused(tmp_path, refused, case):
    make, says = SCENES[case]
    refused(says, "--scene", make(tmp_path), "--out", "run", "--workers", 1)
    assert not (tmp_path / "run").exists()


def test_a_failed_run_says_what_its_folder_keeps_and_it_is_reused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_mesh(tmp_path / "room.glb", room(1.0))
    command = ["collect", "--scene", "room.glb", "--out", "run", "--robot", "vlnce"]
    command += ["--workers", "1", "--episodes", "1", "--only-episodes", "--min-crossings", "0"]
    assert main([*command, "--min-length-m", "12"]) == 2
    error, hint = capsys.readouterr().err.splitlines()[-2:]
    assert error.startswith("vlnpe: error: room: no episode of 12 … 20 m")
    assert hint.strip().startswith(f"{tmp_path / 'run'} keeps what is finished (repair 1, ")
    assert "the same command goes on from there" in hint
    assert main([*command, "--min-length-m", "2", "--json"]) == 0
    stages = json.loads(capsys.readouterr().out.splitlines()[-1])["stages"]
    assert (stages["repair"]["reused"], stages["repair"]["done"]) == (1, 0)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--robot", "Aliengoo"), "(did you mean aliengo?); valid: "),
        (("--controller", "telepathy"), "path"),
        (("--controller", "path,telepathy"), "telepathy"),
        (("--controller", "walk"), "valid: all, auto, flash, path, speed"),
        (("--controller", "auto,path"), "auto stands alone"),
        (("--min-length-m", "30"), "--min-length-m 30 and --max-length-m 20; valid: "),
        (("--controller", "path,"), "--controller path,: contains an empty name"),
        (("--robot", "h1,,g1"), "--robot h1,,g1: contains an empty name"),
        (("--controller", "sped"), "(did you mean speed?); valid: all"),
        (("--light", "DL500"), "(did you mean DL5000?); valid: CL"),
        (("--camera", "chasse"), "(did you mean chase?); valid: chase"),
        (("--episodes", "gru_vln1"), "--episodes gru_vln1 (did you mean gru_vln10?): valid"),
        (("--scene", "bultin"), "(did you mean builtin?): no such file; valid: builtin, "),
        (("--scene", "builtin-exct:villa*3"), "(did you mean builtin-exact?): no such file"),
        (("--scene", "builtin:ofice"), "(did you mean office?); valid: apartment"),
        (("--robot", "vlnce", "--controller", "path"), "flash"),
        (("--camera", "rear"), "unknown camera 'rear'; valid: chase, ego, rig:125cm_30deg"),
        (("--light", "disco"), "baked"),
        (("--episodes", "0"), "--episodes 0"),
        (("--episodes", "none.json.gz"), "none.json.gz"),
        (("--scenes", "nowhere"), "nowhere"),
        (("--frames-per-second", "7"), "25"),
        (("--min-length-m", "30"), "30"),
        (("--workers", "-1"), "--workers -1"),
    ],
)
def test_invalid_options_list_the_valid_ones(tmp_path, refused, options, says):
    refused(says, *options, "--out", "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("command", [("collect", "--scene"), ("repair",)])
def test_what_is_no_scan_by_its_name_is_refused_before_any_work(
    tmp_path, monkeypatch, capsys, command
):
    monkeypatch.chdir(tmp_path)
    Path("README.md").write_text("# A project")
    assert main([*command, "README.md", "--out", "run"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "README.md: unknown file type '.md'; valid: .glb, " in line
    assert not Path("run").exists()


def test_an_output_folder_that_is_a_file(tmp_path, refused):
    (tmp_path / "run").write_text("mine")
    refused("run", "--out", "run")
    assert (tmp_path / "run").read_text() == "mine"


def test_a_folder_that_is_not_writable(refused):
    # /proc refuses everybody, root too, which a folder's mode bits would not.
    refused("not writable", "--out", "/proc/run")


def test_a_full_disk(tmp_path, refused, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=5 * 1024**2))
    refused("only 5 MiB free", "--out", "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("verb", ["repair", "scan"])
def test_a_stage_never_replaces_a_folder_that_is_not_its_own(tmp_path, monkeypatch, capsys, verb):
    monkeypatch.chdir(tmp_path)
    room_file = write_mesh(tmp_path / "room.glb", room(1.0))
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("years of work")
    source = {"repair": str(room_file), "scan": "0"}[verb]
    assert main([verb, source, "--out", "thesis"]) == 2
    assert "not empty" in capsys.readouterr().err
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "years of work"
