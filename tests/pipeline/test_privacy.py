"""A run opens no socket and writes nothing outside its folder."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.collectors.test_replay import make_episode
from tests.support.scenes import scans
from tests.support.scenes.rooms import write_two_rooms
from vlnpe.formats.vlnce.files import write_episodes

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).resolve().parents[2]
WRITES = "openat,open,creat,mkdir,mkdirat,rename,renameat,renameat2,link,linkat,symlink,symlinkat"
# Compiled code beside its source; locks between worker processes; terminals and the like.
ALLOWED = re.compile(rf"{re.escape(str(REPOSITORY))}/.*__pycache__|/dev/|/proc/self/|pipe:|socket:")
CALL = re.compile(r"^\d+ +(?P<name>\w+)\((?P<rest>.*)$")
PATH = re.compile(r'(?:(?P<at>AT_FDCWD|\d+)(?:<(?P<folder>[^>]*)>)?, )?"(?P<path>[^"]*)"')


@dataclass(frozen=True)
class Trace:
    """System calls of a command and all its children."""

    text: str

    def sockets(self) -> list[str]:
        return re.findall(r"^\d+ +(?:socket|connect)\(.*$", self.text, re.MULTILINE)

    def written(self) -> set[Path]:
        """Absolute paths that were created, opened for writing or renamed, successfully."""
        paths = set()
        for line in self.text.splitlines():
            call = CALL.match(line)
            if not call or " = -1 " in line:
                continue
            rest = call["rest"]
            if call["name"].startswith("open") and not re.search("O_WRONLY|O_RDWR|O_CREAT", rest):
                continue
            for found in PATH.finditer(rest):
                paths.add(Path(found["folder"] or "/unknown", found["path"]))
        return paths


def traced(folder: Path, *arguments: object) -> Trace:
    """Run vlnpe under strace in a new home, with a working folder and a temporary one."""
    strace = shutil.which("strace")
    if not strace:
        pytest.skip("strace is not installed")
    for name in ("home", "cwd", "tmp"):
        (folder / name).mkdir(exist_ok=True)
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("XDG_", "MPL", "NUMBA_CACHE"))
    }
    environment |= {"HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp")}
    log = folder / "trace.txt"
    command = [strace, "-f", "-qq", "-y", "-e", f"trace=socket,connect,{WRITES}", "-o", str(log)]
    command += [sys.executable, "-m", "vlnpe.pipeline.cli", *map(str, arguments)]
    done = subprocess.run(
        command, cwd=folder / "cwd", env=environment, capture_output=True, text=True, check=False
    )
    if "ptrace" in done.stderr and not log.stat().st_size:
        pytest.skip(f"strace may not trace here: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr[-3000:]
    return Trace(log.read_text(errors="replace"))


def check(trace: Trace, folder: Path) -> None:
    assert trace.sockets() == []
    own = (folder / "out", folder / "tmp")
    outside = {
        str(path)
        for path in trace.written()
        if not any(path.is_relative_to(place) for place in own) and not ALLOWED.match(str(path))
    }
    assert outside == set()
    assert list((folder / "home").rglob("*")) == []
    assert list((folder / "cwd").rglob("*")) == []
    # Of the temporary files nothing is left.
    assert list((folder / "tmp").rglob("*")) == []


def test_the_tracer_sees_a_socket_and_a_file_at_home(tmp_path: Path):
    """The test below could fail."""
    script = "import socket, pathlib; socket.socket(); (pathlib.Path.home() / 'x').write_text('')"
    strace = shutil.which("strace")
    if not strace:
        pytest.skip("strace is not installed")
    log = tmp_path / "trace.txt"
    command = [strace, "-f", "-qq", "-y", "-e", f"trace=socket,connect,{WRITES}", "-o", str(log)]
    environment = {**os.environ, "HOME": str(tmp_path)}
    subprocess.run([*command, sys.executable, "-c", script], env=environment, check=True)
    trace = Trace(log.read_text())
    assert len(trace.sockets()) == 1
    assert tmp_path / "x" in trace.written()


def test_robots_and_instruct_stay_at_home(tmp_path: Path):
    bundle = write_two_rooms(tmp_path / "scenes" / "two_rooms")
    write_episodes(tmp_path / "episodes.json.gz", [make_episode(bundle)])
    check(traced(tmp_path, "robots"), tmp_path)
    instructed = tmp_path / "out" / "told.json.gz"
    instructed.parent.mkdir()
    given = ("instruct", tmp_path / "episodes.json.gz", "--scenes", tmp_path / "scenes")
    check(traced(tmp_path, *given, "--out", instructed), tmp_path)
    assert instructed.is_file()


def test_the_whole_chain_stays_at_home(tmp_path: Path):
    scan = scans.write_glb(scans.two_rooms(1.0), tmp_path / "scan.glb")
    scene = ("--scene", scan, "--episodes", 1, "--min-length-m", 2, "--min-crossings", 0)
    robots = ("--robot", "h1,vlnce", "--light", "baked,CL", "--camera", "ego:96x72:90")
    trace = traced(
        tmp_path, "collect", *scene, *robots, "--out", tmp_path / "out" / "run", "--workers", 1
    )
    assert (tmp_path / "out" / "run" / "report" / "index.html").is_file()
    check(trace, tmp_path)


def test_repair_stays_at_home(tmp_path: Path):
    scan = scans.write_glb(scans.two_rooms(1.0), tmp_path / "scan.glb")
    check(traced(tmp_path, "repair", scan, "--out", tmp_path / "out" / "scene"), tmp_path)


@pytest.mark.parametrize("policy", ["random", "cma"])
def test_evaluate_stays_at_home(tmp_path: Path, policy: str):
    pytest.importorskip("torch", reason="the extra `train` is not installed")
    run = tmp_path / "out" / "run"
    bundle = write_two_rooms(run / "scenes" / "two_rooms")
    (run / "episodes").mkdir()
    write_episodes(run / "episodes" / "val.json.gz", [make_episode(bundle)])
    given = ("evaluate", run, "--policy", policy, "--robot", "vlnce", "--workers", 1)
    check(traced(tmp_path, *given), tmp_path)
    assert list((run / "evaluations").glob("*/results.json"))
