"""One process at a time in a run folder."""

import errno
import fcntl
import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from tests.durability.test_signals import lingering, lives, start, until  # noqa: F401
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.context import open_context
from vlnpe.pipeline.engine import lock as locks
from vlnpe.pipeline.engine.holder import Holder
from vlnpe.pipeline.engine.ledger import MANIFEST_NAME, Ledger
from vlnpe.pipeline.engine.lock import LOCK_NAME, LockedError, lock, refuse_if_locked
from vlnpe.pipeline.options.running import Running
from vlnpe.pipeline.verify.run import verify_run


@pytest.fixture(params=[True, False], ids=["flock", "no flock"])
def flock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """File systems with and without flock."""
    if not request.param:

        def refuse(*_: object) -> None:
            raise OSError(errno.ENOLCK, "No locks available")

        monkeypatch.setattr(fcntl, "flock", refuse)
    monkeypatch.setattr(locks, "SETTLE_S", 0.05)
    return request.param


def test_a_second_holder_is_refused_with_the_name_of_the_first(tmp_path: Path, flock: bool):
    with lock(tmp_path):
        if flock:  # the kernel keeps holders apart also within a process
            refused = pytest.raises(LockedError, match=f"process {os.getpid()} on .*--wait")
            with refused, lock(tmp_path):
                pass
        with pytest.raises(LockedError, match=f"in use by process {os.getpid()} on"):
            refuse_if_locked(tmp_path)
    assert not (tmp_path / LOCK_NAME).exists()
    refuse_if_locked(tmp_path)
    with lock(tmp_path):
        pass


def leave(folder: Path, holder: Holder, age_s: float = 0.0) -> None:
    """Leave a lock as a process that has died does."""
    path = folder / LOCK_NAME
    path.write_text(json.dumps(asdict(holder)))
    then = time.time() - age_s
    os.utime(path, (then, then))


def dead_pid() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_locks_of_dead_processes_are_taken_over(tmp_path: Path, flock: bool):
    leave(tmp_path, replace(Holder.this(), pid=dead_pid(), token="x"))
    refuse_if_locked(tmp_path)
    with lock(tmp_path):
        found = Holder.read(tmp_path / LOCK_NAME)
        assert found is not None and found.pid == os.getpid()
    # A process id that is used again is another process.
    leave(tmp_path, replace(Holder.this(), started="1", token="x"))
    with lock(tmp_path):
        pass
    (tmp_path / LOCK_NAME).write_text("{cut short")
    then = time.time() - 1000
    os.utime(tmp_path / LOCK_NAME, (then, then))
    with lock(tmp_path):
        pass


def test_another_machine_holds_it_as_long_as_it_renews_it(tmp_path: Path, flock: bool):
    elsewhere = replace(Holder.this(), host="node7", boot="other", pid=1, token="x")
    leave(tmp_path, elsewhere)
    with pytest.raises(LockedError, match="process 1 on node7"), lock(tmp_path):
        pass
    leave(tmp_path, elsewhere, age_s=locks.STALE_S + 5)
    with lock(tmp_path):
        pass


def test_a_holder_renews_its_lock_and_stops_when_it_was_taken_over(tmp_path: Path, monkeypatch):
    killed: list[int] = []
    monkeypatch.setattr(locks, "RENEW_S", 0.05)
    monkeypatch.setattr(locks.os, "kill", lambda pid, number: killed.append(number))
    with lock(tmp_path):
        path = tmp_path / LOCK_NAME
        os.utime(path, (1, 1))
        until(lambda: path.stat().st_mtime > 1000, 10.0)
        leave(tmp_path, replace(Holder.this(), host="node7", token="x"))
        until(lambda: bool(killed), 10.0)
    assert (tmp_path / LOCK_NAME).exists()  # it is the other's now


@pytest.mark.chain
def test_two_commands_on_one_folder(tmp_path: Path, start):  # noqa: F811
    root = tmp_path / "run"
    first = start(lingering(root, 6))
    until(lambda: len(list(root.glob("*.pid"))) >= 2)
    with pytest.raises(InputError, match=f"in use by process {first.pid} on"):
        verify_run(root)
    refused = pytest.raises(InputError, match=f"in use by process {first.pid} on")
    with refused, open_context(root, Running(workers=1)):
        pass
    assert len(list(root.glob(f"{TEMPORARY_PREFIX}*"))) == 2  # not swept away
    second = start(lingering(root, 0, "--wait"))
    _, output = second.communicate(timeout=120)
    assert first.wait() == 0 and second.returncode == 0, output
    assert f"in use by process {first.pid}" in output and "reused 4" in output
    assert len(Ledger(root).rows()) == 4


def test_a_run_inside_another_keeps_its_unfinished_files(tmp_path: Path):
    inner = tmp_path / "run" / "evaluations" / "a"
    inner.mkdir(parents=True)
    (tmp_path / "run" / MANIFEST_NAME).write_text('{"rows": []}')
    living = inner / f"{TEMPORARY_PREFIX}x.abcdefgh.mcap"
    dead = tmp_path / "run" / f"{TEMPORARY_PREFIX}x.abcdefgh.mcap"
    living.write_text("")
    dead.write_text("")
    with lock(inner), open_context(tmp_path / "run", Running(workers=1)):
        assert living.exists() and not dead.exists()
    with open_context(tmp_path / "run", Running(workers=1)):
        assert not living.exists()
    assert not lives(dead_pid())
