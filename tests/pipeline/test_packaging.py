"""What a user installs is what stands in the tree."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUPTOOLS = PROJECT["tool"]["setuptools"]
ROOMS = [
    "collectors",
    "datasets",
    "formats",
    "instruction_gen",
    "pipeline",
    "scene_repair",
    "trajectory_sampler",
]


def package_folders() -> list[str]:
    found = []
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            found.append(path.parent.relative_to(ROOT).as_posix())
    return sorted(set(found))


def test_import_datasets_from_the_root_is_hugging_faces():
    code = "import datasets; print(datasets.__file__); datasets.Dataset"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "site-packages" in done.stdout
    assert not (ROOT / "datasets" / "__init__.py").exists()


def test_our_datasets_room_imports_beside_it():
    code = "import vlnpe.datasets.local as l, datasets; print(l.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()) == ROOT / "datasets" / "local.py"


def test_every_package_folder_is_listed():
    listed = sorted(SETUPTOOLS["package-dir"].values())
    assert listed == package_folders()
    assert sorted(SETUPTOOLS["packages"]) == sorted(SETUPTOOLS["package-dir"])


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> set[str]:
    out = tmp_path_factory.mktemp("wheel")
    # In a child process: build backends change global state.
    code = f"import setuptools.build_meta as b; b.build_wheel({str(out)!r})"
    copy = tmp_path_factory.mktemp("source")
    for name in [*ROOMS, "pyproject.toml", "README.md", "LICENSE"]:
        subprocess.run(["cp", "-r", str(ROOT / name), str(copy)], check=True)
    subprocess.run([sys.executable, "-c", code], cwd=copy, check=True, capture_output=True)
    with zipfile.ZipFile(next(out.glob("*.whl"))) as archive:
        return set(archive.namelist())


def test_the_wheel_holds_every_source_and_data_file(wheel):
    suffixes = {".py", ".xml", ".onnx", ".json", ".j2", ".yaml"}
    missing = [
        path.relative_to(ROOT).as_posix()
        for room in ROOMS
        for path in (ROOT / room).rglob("*")
        if path.suffix in suffixes and "__pycache__" not in path.parts
        if f"vlnpe/{path.relative_to(ROOT).as_posix()}" not in wheel
    ]
    assert missing == []


def test_rooms_import_only_what_lies_below_them():
    """Floor 1 imports no room; floor 2 imports floor 1 only; the pipeline may import all."""
    floor_two = set(ROOMS) - {"formats", "pipeline"}
    wrong = []
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            depth = len(path.relative_to(ROOT).parts)
            for line in path.read_text().splitlines():
                words = line.split()
                if len(words) < 2 or words[0] != "from" or not words[1].startswith("." * depth):
                    continue
                target = words[1].lstrip(".").split(".")[0]
                allowed = {
                    "formats": {"formats"},
                    "pipeline": floor_two | {"formats", "pipeline"},
                }.get(room, {room, "formats"})
                if target in ROOMS and target not in allowed:
                    wrong.append(f"{path.relative_to(ROOT)}: {line.strip()}")
    assert wrong == []
