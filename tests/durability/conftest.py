"""A small run of the whole chain on a scan of two rooms, made by the command."""

from pathlib import Path

import pytest

from tests.support.runs import tiny_run


@pytest.fixture(scope="session")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scan of two rooms."""
    return tiny_run.write_scan(tmp_path_factory.mktemp("tiny") / "scan.glb")


@pytest.fixture(scope="session")
def finished(scan: Path) -> Path:
    """A complete run; tests only read it, or copy it."""
    done = tiny_run.collect(scan, scan.with_name("run"))
    assert done.returncode == 0, done.stderr[-3000:]
    return scan.with_name("run")


@pytest.fixture(scope="session")
def prepared(finished: Path) -> Path:
    """A run that has only repaired its scene."""
    return tiny_run.prepare(finished, finished.with_name("prepared"))
