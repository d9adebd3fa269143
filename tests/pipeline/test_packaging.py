"""The installed package equals the source tree, and imports point to lower layers."""

import ast
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# A package imports packages on lower layers only; a test below reads this.
LAYERS = {
    "formats": 1.0,
    "geometry": 1.5,
    "wayfinding": 1.5,
    "apartments": 2.0,
    "collectors": 2.0,
    "datasets": 2.0,
    "instruction_gen": 2.0,
    "scene_repair": 2.0,
    "trajectory_sampler": 2.0,
    "rendering": 2.2,
    "learning": 2.5,
    "evaluation": 3.0,
    "viewer": 3.5,
    "pipeline": 4.0,
}
PACKAGES = sorted(LAYERS)
MAX_POSITIONAL = 7
# Decorators of compiled functions: numba knows no keyword-only parameters and passes no records.
COMPILED = {"called", "inlined", "intrinsic", "kernel", "njit"}


@pytest.mark.chain
def test_import_datasets_from_the_root_is_hugging_faces():
    if find_spec("lerobot") is None:  # it brings Hugging Face's
        pytest.skip("the extra `train` is not installed")
    code = "import datasets; print(datasets.__file__); datasets.Dataset"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "site-packages" in done.stdout
    assert not (ROOT / "datasets" / "__init__.py").exists()


@pytest.mark.chain
def test_our_datasets_package_imports_beside_it():
    code = "import vlnpe.datasets.local as l, datasets; print(l.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()) == ROOT / "datasets" / "local.py"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> set[str]:
    if find_spec("setuptools") is None:
        pytest.skip("the group `dev` is not installed")
    out = tmp_path_factory.mktemp("wheel")
    # In a child process: build backends change global state.
    code = f"import setuptools.build_meta as b; b.build_wheel({str(out)!r})"
    copy = tmp_path_factory.mktemp("source")
    for name in (*PACKAGES, "package"):  # without what another test is compiling
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    subprocess.run([sys.executable, "-c", code], cwd=copy, check=True, capture_output=True)
    with zipfile.ZipFile(next(out.glob("*.whl"))) as archive:
        return set(archive.namelist())


@pytest.mark.chain
def test_the_wheel_holds_every_source_and_data_file(wheel):
    suffixes = {".py", ".txt", ".xml", ".onnx", ".safetensors", ".json", ".j2", ".yaml"}
    missing = [
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in suffixes and "__pycache__" not in path.parts
        if f"vlnpe/{path.relative_to(ROOT).as_posix()}" not in wheel
    ]
    assert missing == []
    assert {"vlnpe/__init__.py", "vlnpe/py.typed"} <= wheel


def test_packages_import_only_lower_layers():
    wrong = []
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            depth = len(path.relative_to(ROOT).parts)
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.ImportFrom) or node.level < depth:
                    continue
                names = [node.module] if node.module else [alias.name for alias in node.names]
                for target in (name.split(".")[0] for name in names):
                    if target != package and LAYERS[target] >= LAYERS[package]:
                        wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} imports {target}")
    assert wrong == []


def test_no_function_takes_more_than_seven_positional_parameters():
    long = []
    for package in sorted({*PACKAGES, "benchmarks", "examples", "tests"}):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                    continue
                marks = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
                if any(isinstance(mark, ast.Name) and mark.id in COMPILED for mark in marks):
                    continue
                names = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
                count = len(names) - (names[:1] in (["self"], ["cls"]))
                if count > MAX_POSITIONAL:
                    long.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}: {count}")
    assert long == []
