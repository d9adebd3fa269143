"""The set-up finds interpreters, honours its stamp and calls uv with the right words."""

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2]
SCRIPT = Path("pipeline") / "bootstrap.py"
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
# Old interpreters, where a machine has them.
OLD = sorted(map(str, (Path.home() / ".pyenv" / "versions").glob("3.[6-9].*/bin/python")))

# Records its arguments, one per line, and what it was told to use. `sync` makes the environment's
# folder as the real one does, unless told to fail.
FAKE_UV = """#!/bin/sh
if [ "$1" = --version ]; then echo "uv ${FAKE_VERSION:-0.9.0}"; exit 0; fi
for word in "$@"; do echo "$word"; done > "$RECORD"
echo "UV_PYTHON=$UV_PYTHON" >> "$RECORD"
echo "VIRTUAL_ENV=$VIRTUAL_ENV" >> "$RECORD"
/bin/mkdir -p "$FAKE_ENVIRONMENT"
exit ${FAKE_CODE:-0}
"""


class Machine:
    """A copy of what the set-up reads, on a machine with nothing but a fake uv on PATH."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root = folder / "a checkout"
        (self.root / "pipeline").mkdir(parents=True)
        for name in ("pyproject.toml", "uv.lock", SCRIPT):
            shutil.copyfile(SOURCE / name, self.root / name)
        self.record = folder / "record"
        self.home = folder / "home"
        (folder / "bin").mkdir()
        self.home.mkdir()
        for name in ("UV_PYTHON", "PYENV_ROOT", "VIRTUAL_ENV", "VERBOSE"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("HOME", str(self.home))
        monkeypatch.setenv("PATH", str(folder / "bin"))
        monkeypatch.setenv("RECORD", str(self.record))
        monkeypatch.setenv("FAKE_ENVIRONMENT", str(self.root / ".venv"))
        uv = folder / "bin" / "uv"
        uv.write_text(FAKE_UV)
        uv.chmod(0o755)

    def run(self, *arguments: str, python: str = sys.executable) -> tuple[int, str, list[str]]:
        """Return the exit code, what was printed, and the words of uv's call, if any."""
        done = subprocess.run(
            [python, "-B", str(self.root / SCRIPT), *arguments], capture_output=True, text=True
        )
        words = self.record.read_text().splitlines() if self.record.exists() else []
        self.record.unlink(missing_ok=True)
        return done.returncode, done.stderr, words


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    if os.name == "nt":
        pytest.skip("the fake uv is a shell script")
    yield Machine(tmp_path, monkeypatch)


def add_pyenv(versions: Path, name: str) -> Path:
    """Return an interpreter under pyenv's `versions/` that runs this one."""
    python = versions / name / "bin" / "python3"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    return python


@pytest.mark.parametrize("kind", ["core", "full"])
@pytest.mark.parametrize("own_root", [False, True])
def test_syncs_the_lock_once_with_a_python_of_pyenv(
    machine: Machine, kind: str, own_root: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pyenv = machine.home / ("elsewhere" if own_root else ".pyenv")
    if own_root:
        monkeypatch.setenv("PYENV_ROOT", str(pyenv))
    monkeypatch.setenv("VIRTUAL_ENV", "/another/environment")
    python = add_pyenv(pyenv / "versions", f"{HERE}.99")
    old = pyenv / "versions" / "3.12.0" / "bin" / "python3"  # by its own word another version
    old.parent.mkdir(parents=True)
    old.write_text("#!/bin/sh\n")
    old.chmod(0o755)
    code, _, (*command, chosen, environment) = machine.run(kind)
    words = ["--inexact"] if kind == "core" else ["--all-extras", "--group", "dev"]
    assert code == 0
    assert command == ["sync", "--frozen", "--project", str(machine.root), *words, "--quiet"]
    assert python.samefile(chosen[len("UV_PYTHON=") :])
    assert environment == "VIRTUAL_ENV="  # else uv would warn, or fill the wrong folder
    assert machine.run(kind) == (0, "", [])
    (machine.root / "uv.lock").open("a").write("# changed\n")
    assert machine.run(kind)[2]


def test_the_users_choice_of_python_wins(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UV_PYTHON", "/my/python")
    add_pyenv(machine.home / ".pyenv" / "versions", f"{HERE}.99")
    assert "UV_PYTHON=/my/python" in machine.run("core")[2]


def test_adds_extras_to_the_core_and_full_has_them_all(machine: Machine) -> None:
    _, _, words = machine.run("core", "train, scan")
    assert words[4:-2] == ["--inexact", "--extra", "scan", "--extra", "train", "--quiet"]
    assert machine.run("core", "scan,train")[2] == machine.run("core", "train scan")[2] == []
    assert machine.run("core")[2] and machine.run("full")[2]
    (machine.root / ".venv" / ".vlnpe-core").unlink()
    assert machine.run("core")[2] == machine.run("core", "s3")[2] == []


def test_a_failed_sync_is_tried_again(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_CODE", "3")
    code, printed, words = machine.run("core")
    assert code == 1 and words and "VERBOSE=1 shows" in printed
    assert not list((machine.root / ".venv").iterdir())
    monkeypatch.setenv("FAKE_CODE", "0")
    monkeypatch.setenv("VERBOSE", "1")
    code, _, words = machine.run("core")
    assert code == 0 and "--quiet" not in words


def test_an_old_uv_is_not_used(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_VERSION", "0.4.30")
    spec = importlib.util.spec_from_file_location("bootstrap_under_test", machine.root / SCRIPT)
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    installed: list[list[str]] = []
    monkeypatch.setattr(script.subprocess, "check_call", installed.append)
    monkeypatch.setattr(script, "download_pip", lambda: Path("/pip.whl"))
    for name in ("executable", "no-python"):  # this Python has pip, or it does not
        monkeypatch.setattr(script.sys, "executable", str(machine.home / name))
        assert script.find_uv() == str(machine.root / ".tools" / "bin" / "uv")
    words = ["install", "-q", "--target", str(machine.root / ".tools"), script.UV]
    assert [command[2:] for command in installed] == [words, words]


def test_pyright_finds_the_package_in_a_checkout_of_any_name(machine: Machine) -> None:
    for _ in range(2):
        assert machine.run("full")[0] == 0
        assert (machine.root / ".venv" / "types" / "vlnpe").samefile(machine.root)
        (machine.root / ".venv" / ".vlnpe-full").unlink()


@pytest.mark.parametrize("arguments", [[], ["everything"], ["core", "scan", "s3"], ["--help"]])
@pytest.mark.parametrize("python", [sys.executable, *OLD])
def test_a_bad_argument_is_refused_by_every_python(
    machine: Machine, arguments: list[str], python: str
) -> None:
    code, printed, words = machine.run(*arguments, python=python)
    assert code == 1 and not words
    assert printed.startswith("usage: ") and "core|test|full" in printed
