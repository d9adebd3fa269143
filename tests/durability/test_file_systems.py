"""Full and read-only disks, no hard links, coarse times, clocks that jump."""

import errno
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.runs import work
from tests.support.runs.content import content
from tests.support.runs.work import InlineWorkers
from vlnpe.formats.core.atomic import TEMPORARY_PREFIX
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.context import open_context, run_single
from vlnpe.pipeline.engine.ledger import Ledger
from vlnpe.pipeline.engine.work import WorkItem
from vlnpe.pipeline.execution import settings as executors
from vlnpe.pipeline.execution.runner import Context, StageSummary, run_stage
from vlnpe.pipeline.options.running import Running
from vlnpe.pipeline.stages.datasets.export_job import UnitJob
from vlnpe.pipeline.verify.integrity import check_files

pytestmark = pytest.mark.chain


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if os.geteuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root can mount a small tmpfs")
    mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"a tmpfs cannot be mounted here: {mounted.stderr.strip()}")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def remount(disk: Path, option: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{option}", str(disk)], check=True)


def write_all(root: Path, size: int = 200_000) -> StageSummary:
    paths = [root / f"{name}.txt" for name in "abcdefgh"]
    items = [WorkItem(p.stem, "k", (p,), work.Call(work.write, (p, "x" * size))) for p in paths]
    return run_stage(Context(Ledger(root), InlineWorkers(1), progress=False), "s", items)


def test_a_full_disk_ends_the_run_and_room_lets_it_go_on(small_disk: Path):
    with pytest.raises(InputError, match="No space left on device"):
        write_all(small_disk)
    done = len(Ledger(small_disk).rows("s"))
    assert done < 8
    assert not list(small_disk.glob(f"{TEMPORARY_PREFIX}*"))
    remount(small_disk, "size=8m")
    summary = write_all(small_disk)
    assert (summary.reused, summary.done) == (done, 8 - done)
    assert not any(check.problem for check in check_files(Ledger(small_disk)))


def test_a_read_only_disk_is_refused_in_a_sentence(small_disk: Path):
    (small_disk / "run").mkdir()
    remount(small_disk, "ro")
    refused = pytest.raises(InputError, match="not writable \\(Read-only file system\\)")
    with refused, open_context(small_disk / "run", Running(workers=1)):
        pass


def test_without_hard_links_units_are_copies(finished: Path, tmp_path: Path, monkeypatch):
    (row, *_) = Ledger(finished).rows("export")
    unit = finished / row.outputs[0]
    frames = finished / "frames" / row.item
    rollout = finished / "rollouts" / "vlnce" / "flash" / f"{unit.name}.mcap"

    def refuse(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    UnitJob(rollout, frames, tmp_path / "unit", "video", tmp_path / "none").run()
    assert content(tmp_path / "unit") == content(unit)
    assert (tmp_path / "unit" / "observation.images.rgb.mp4").stat().st_nlink == 1


def test_times_of_files_and_clocks_decide_nothing(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(executors, "Workers", InlineWorkers)
    out = tmp_path / "out.txt"

    def once() -> float:
        item = WorkItem("one", "k", (out,), work.Call(work.write, (out, "hello")))
        row = run_single(out, "s", item)
        return row.seconds

    first = once()
    # A copy or a restored backup has other times; nothing is made again.
    os.utime(out, (1, 1))
    year_s = 365 * 86400.0
    real = time.time
    for jump_s in (-year_s, year_s):
        monkeypatch.setattr(time, "time", lambda jump_s=jump_s: real() + jump_s)
        assert once() == first
    # Where times are of two seconds, an edit of the same size shows in nothing but the content.
    stat = out.stat()
    out.write_text("jello")
    os.utime(out, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    once()
    assert out.read_text() == "hello"
