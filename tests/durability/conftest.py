"""A small run of the whole chain on a scan of two rooms, made by the command."""

from pathlib import Path

import pytest

from tests.support.machine import once
from tests.support.runs import tiny_run


@pytest.fixture(scope="session")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan of two rooms."""
    return once(tmp_path_factory, "tiny", _collect) / "scan.glb"


@pytest.fixture(scope="session")
def finished(scan: Path) -> Path:
    """A complete run; tests only read it, or copy it."""
    return scan.with_name("run")


@pytest.fixture(scope="session")
def prepared(finished: Path) -> Path:
    """A run that has only repaired its scene."""
    return finished.with_name("prepared")


def _collect(folder: Path) -> None:
    scan, run = tiny_run.write_scan(folder / "scan.glb"), folder / "run"
    done = tiny_run.run(tiny_run.command(scan, run, "--workers", 1))
    assert done.returncode == 0, done.stderr[-3000:]
    tiny_run.prepare(run, folder / "prepared")
