"""SIGTERM, Ctrl-C and SIGKILL: the command ends in a line, and no worker outlives it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.runs import tiny_run
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX
from vlnpe.pipeline.context import open_context
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.options.running import Running

pytestmark = pytest.mark.chain

TOP = Path(__file__).parents[2]


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start commands as a terminal does, each in a process group of its own."""
    started: list[subprocess.Popen[str]] = []

    def begin(command: list[str]) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=tiny_run.environment(PYTHONPATH=str(TOP)),
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.parametrize("number", ["INT", "HUP"])
def test_tests_in_the_background_start_processes_with_default_signals(number: str) -> None:
    asked = f"import signal; print(signal.getsignal(signal.SIG{number}) is signal.SIG_IGN)"
    code = (
        "import subprocess, sys; from tests.support.signals import let_children_have_defaults\n"
        f"ask = lambda: subprocess.run([sys.executable, '-c', {asked!r}])\n"
        f"ask(); let_children_have_defaults(); ask()\n{asked}"
    )
    done = subprocess.run(
        ["bash", "-c", f'trap \'\' {number};exec "$0" -u -c "$1"', sys.executable, code],
        cwd=TOP,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "False", "False"]


def lingering(root: Path, *options: object) -> list[str]:
    return [sys.executable, "-m", "tests.support.runs.lingering", str(root), *map(str, options)]


def until(true: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.05)


def workers_of(root: Path) -> list[int]:
    until(lambda: len(list(root.glob("*.pid"))) >= 2)
    return [int(path.read_text()) for path in root.glob("*.pid")]


def lives(pid: int) -> bool:
    """Return whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def unfinished(root: Path) -> list[Path]:
    return list(root.rglob(f"{TEMPORARY_PREFIX}*"))


@pytest.mark.parametrize(
    ("number", "presses"), [(signal.SIGTERM, 1), (signal.SIGINT, 1), (signal.SIGINT, 2)]
)
def test_a_signal_ends_the_run_in_one_line(tmp_path: Path, start, number: int, presses: int):
    process = start(lingering(tmp_path / "run", 100))
    pids = workers_of(tmp_path / "run")
    for _ in range(presses):
        # Ctrl-C goes to the whole group; `kill` and a batch system's SIGTERM to the process.
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
    _, output = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert "Traceback" not in output and output.count("\nvlnpe: ") == 1
    assert f"{signal.Signals(number).name}: stopping; run the same command again" in output
    until(lambda: not any(map(lives, pids)), 30.0)
    if presses == 1:
        assert unfinished(tmp_path / "run") == []
    with open_context(tmp_path / "run", Running(workers=1)):  # the next run cleans up
        assert unfinished(tmp_path / "run") == []


def test_workers_end_with_a_process_that_was_killed(tmp_path: Path, start):
    process = start(lingering(tmp_path / "run", 100))
    pids = workers_of(tmp_path / "run")
    process.kill()
    process.wait()
    until(lambda: not any(map(lives, pids)), 60.0)
    assert len(unfinished(tmp_path / "run")) == 2
    with open_context(tmp_path / "run", Running(workers=1)) as context:
        assert unfinished(tmp_path / "run") == []
        assert context.ledger.rows() == []


def test_a_killed_worker_costs_its_items_a_second_try_and_leaves_nothing(tmp_path: Path, start):
    process = start(lingering(tmp_path / "run", 3))
    os.kill(workers_of(tmp_path / "run")[0], signal.SIGKILL)  # as for memory
    _, output = process.communicate(timeout=120)
    assert process.returncode == 0, output
    assert [row.item for row in Ledger(tmp_path / "run").rows()] == list("abcd")
    assert unfinished(tmp_path / "run") == []


def handles(pid: int, number: int) -> bool:
    """Return whether a process has installed a handler; Python itself has none for SIGTERM."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


def test_no_worker_ever_receives_ctrl_c():
    code = (
        "import signal; from vlnpe.pipeline.execution.processes import Workers\n"
        "with Workers(1) as workers:\n"
        "    held = workers.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()\n"
        "print(signal.SIGINT in held)"
    )
    done = tiny_run.run([sys.executable, "-c", code])
    assert done.stdout == "True\n", done.stderr


@pytest.mark.parametrize("after_s", [0.0, 0.5])
def test_ctrl_c_at_start_up_prints_no_traceback(tmp_path: Path, start, after_s: float):
    scan = tiny_run.write_scan(tmp_path / "scan.glb")
    process = start(tiny_run.command(scan, tmp_path / "run"))
    until(lambda: handles(process.pid, signal.SIGTERM))
    time.sleep(after_s)
    os.killpg(process.pid, signal.SIGINT)
    _, output = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in output and "SIGINT: stopping" in output
