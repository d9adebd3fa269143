"""The set-up finds interpreters, honours its stamp, calls uv with the right words; no network."""

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

SOURCE = Path(__file__).resolve().parents[2]
SCRIPT = SOURCE / "pipeline" / "bootstrap.py"
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
VERSIONS = Path.home() / ".pyenv" / "versions"

# Old interpreters, where a machine has them: pyenv's, and those on PATH.
OLD = sorted(
    {
        *map(str, VERSIONS.glob("2.7*/bin/python")),
        *map(str, VERSIONS.glob("3.[4-9].*/bin/python")),
        *(
            path
            for v in ("2.7", "3.6", "3.7", "3.8", "3.9")
            # pyenv's shims are on PATH for versions that are not chosen, and then do not run.
            if (path := shutil.which(f"python{v}")) and "shims" not in path
        ),
    }
)

# Records its arguments, one per line, and the interpreter it was told to use. `sync` makes the
# environment's folder as the real one does, unless told to fail.
FAKE_UV = """#!/bin/sh
if [ "$1" = --version ]; then echo "uv ${FAKE_VERSION:-0.9.0}"; exit 0; fi
for word in "$@"; do echo "$word"; done > "$RECORD"
echo "UV_PYTHON=$UV_PYTHON" >> "$RECORD"
echo "VIRTUAL_ENV=$VIRTUAL_ENV" >> "$RECORD"
/bin/mkdir -p "$FAKE_ENVIRONMENT"
echo "Prepared 2 packages in 3ms" >&2
echo "Installed 2 packages in 1ms" >&2
echo " + numpy==2.2.6" >&2
exit ${FAKE_CODE:-0}
"""


class Machine:
    """A copy of what the set-up reads, on a machine with nothing but a fake uv on PATH."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root = folder / "a checkout"
        (self.root / "pipeline").mkdir(parents=True)
        for name in ("pyproject.toml", "uv.lock", "pipeline/bootstrap.py"):
            shutil.copyfile(SOURCE / name, self.root / name)
        self.record = folder / "record"
        self.binaries = folder / "bin"
        self.binaries.mkdir()
        self.home = folder / "home"
        self.home.mkdir()
        for name in ("UV_PYTHON", "PYENV_ROOT", "VIRTUAL_ENV"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("HOME", str(self.home))
        monkeypatch.setenv("PATH", str(self.binaries))
        monkeypatch.setenv("RECORD", str(self.record))
        monkeypatch.setenv("FAKE_ENVIRONMENT", str(self.root / ".venv"))
        uv = self.binaries / "uv"
        uv.write_text(FAKE_UV)
        uv.chmod(0o755)
        self.script = load(self.root / "pipeline" / "bootstrap.py")
        # Whatever goes wrong in a test, nothing may be fetched.
        monkeypatch.setattr(self.script, "urlopen", _no_network)

    def calls(self) -> list[str]:
        """What uv was called with since the last time this was asked; empty without a call."""
        if not self.record.exists():
            return []
        words = self.record.read_text().splitlines()
        self.record.unlink()
        return words


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("bootstrap_under_test", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _no_network(*_: object) -> None:
    raise AssertionError("the set-up went to the network")


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    if os.name == "nt":
        pytest.skip("the fake uv is a shell script")
    yield Machine(tmp_path, monkeypatch)


def add_pyenv(versions: Path, name: str) -> Path:
    """An interpreter under pyenv's `versions/` that runs this one."""
    python = versions / name / "bin" / "python3"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    return python


@pytest.mark.parametrize("own_root", [False, True])
def test_finds_a_python_of_pyenv_that_is_not_on_path(
    machine: Machine, own_root: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "elsewhere" if own_root else machine.home / ".pyenv"
    if own_root:
        monkeypatch.setenv("PYENV_ROOT", str(root))
    assert machine.script.find_python() is None
    python = add_pyenv(root / "versions", f"{HERE}.99")
    found = machine.script.find_python()
    assert found is not None and python.samefile(found)


def test_a_python_is_asked_for_its_version_not_believed(machine: Machine) -> None:
    liar = machine.home / ".pyenv" / "versions" / "3.12.0" / "bin" / "python3"
    liar.parent.mkdir(parents=True)
    liar.write_text("#!/bin/sh\necho '3.9|/bin/sh'\n")
    liar.chmod(0o755)
    assert machine.script.find_python() is None


def test_the_users_choice_of_python_wins(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UV_PYTHON", "/my/python")
    assert machine.script.find_python() == "/my/python"


@pytest.mark.parametrize(
    ("kind", "words"),
    [("core", ["--inexact"]), ("full", ["--all-extras", "--group", "dev"])],
)
def test_syncs_the_lock_once(
    machine: Machine, kind: str, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VIRTUAL_ENV", "/another/environment")
    python = add_pyenv(machine.home / ".pyenv" / "versions", f"{HERE}.99")
    assert machine.script.main([kind]) == 0
    *command, chosen, environment = machine.calls()
    assert command == ["sync", "--project", str(machine.root), "--frozen", *words]
    assert python.samefile(chosen.removeprefix("UV_PYTHON="))
    assert environment == "VIRTUAL_ENV="  # else uv would warn, or fill the wrong folder
    assert machine.script.main([kind]) == 0
    assert machine.calls() == []


def test_adds_extras_to_the_core(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert machine.script.main(["core", "train,scan"]) == 0
        assert machine.calls()[4:-2] == ["--inexact", "--extra", "scan", "--extra", "train"]
        (machine.root / "uv.lock").open("a").write("# changed\n")
    capsys.readouterr()
    assert machine.script.main(["core", "trian"]) == 2
    assert machine.calls() == []
    assert "unknown extra trian (did you mean train?); valid: train" in capsys.readouterr().err


@pytest.mark.parametrize(("code", "verbose"), [("0", ""), ("0", "1"), ("3", "")])
def test_packages_are_listed_where_asked_for_or_needed(
    machine: Machine,
    code: str,
    verbose: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("FAKE_CODE", code)
    monkeypatch.setenv("VERBOSE", verbose)
    assert machine.script.main(["core"]) == int(code)
    told = capfd.readouterr().err
    assert "Installed 2 packages" in told
    assert ("numpy==2.2.6" in told) == bool(int(code) or verbose)


def test_a_current_stamp_needs_nothing_at_all(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    (machine.root / ".venv").mkdir()
    (machine.root / ".venv" / ".vlnpe-core").write_text(machine.script.digest())
    for name in ("find_uv", "find_python", "output_of", "download_uv"):
        monkeypatch.setattr(machine.script, name, _no_network)
    assert machine.script.main(["core"]) == 0
    assert machine.calls() == []


@pytest.mark.parametrize("name", ["uv.lock", "pyproject.toml", "pipeline/bootstrap.py"])
def test_a_change_of_what_it_depends_on_syncs_again(machine: Machine, name: str) -> None:
    assert machine.script.main(["core"]) == 0
    assert machine.calls()
    with (machine.root / name).open("a") as stream:
        stream.write("# changed\n")
    assert machine.script.main(["core"]) == 0
    assert machine.calls()[0] == "sync"
    assert machine.script.main(["core"]) == 0
    assert machine.calls() == []


def test_full_satisfies_core_but_not_the_reverse(machine: Machine) -> None:
    assert machine.script.main(["core"]) == 0
    assert machine.calls()
    assert machine.script.main(["full"]) == 0
    assert "--all-extras" in machine.calls()
    (machine.root / ".venv" / ".vlnpe-core").unlink()
    assert machine.script.main(["core"]) == 0
    assert machine.calls() == []


def test_a_failed_sync_is_tried_again(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FAKE_CODE", "3")
    assert machine.script.main(["core"]) == 3
    assert machine.calls()
    assert not list((machine.root / ".venv").iterdir())
    monkeypatch.setenv("FAKE_CODE", "0")
    assert machine.script.main(["core"]) == 0
    assert machine.calls()


def test_an_old_uv_is_not_used(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def cannot() -> str:
        raise RuntimeError("no way to get uv")

    monkeypatch.setenv("FAKE_VERSION", "0.4.30")
    monkeypatch.setattr(machine.script.sys, "executable", str(machine.binaries / "no-python"))
    monkeypatch.setattr(machine.script, "download_uv", cannot)
    assert machine.script.main(["core"]) == 1
    assert machine.calls() == []
    assert "no way to get uv" in capsys.readouterr().err


def test_pyright_finds_the_package_in_a_checkout_of_any_name(machine: Machine) -> None:
    link = machine.root / ".venv" / "types" / "vlnpe"
    for _ in range(2):
        assert machine.script.main(["full"]) == 0
        assert link.samefile(machine.root)
        (machine.root / ".venv" / ".vlnpe-full").unlink()


@pytest.mark.parametrize(
    "arguments", [[], ["everything"], ["core", "full"], ["core", "scan", "s3"], ["--help"]]
)
def test_a_bad_argument_is_refused(
    machine: Machine, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert machine.script.main(arguments) == 2
    told = capsys.readouterr().err
    assert "core|full" in told or "unknown extra full" in told
    assert machine.calls() == []


@pytest.mark.parametrize("python", OLD or [None])
def test_runs_on_old_interpreters(python: str | None) -> None:
    if python is None:
        pytest.skip("no Python older than 3.10 on this machine")
    # A bad argument: the whole file is compiled and executed, and nothing is installed.
    done = subprocess.run(
        [python, "-B", str(SCRIPT), "nonsense"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done.stderr
    assert "core|full" in done.stderr
