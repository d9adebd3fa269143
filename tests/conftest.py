"""Fixtures shared by all tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.rooms import write_two_rooms
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.video.scheduling import ordinary_threads

SHARED_SCENES = Path(__file__).resolve().parents[2] / "shared" / "scenes"


@pytest.fixture(scope="session")
def _make_threads_ordinary() -> Iterator[Callable[[], None]]:
    with ordinary_threads() as restore:
        yield restore


@pytest.fixture(autouse=True)
def _threads_stay_ordinary(_make_threads_ordinary: Callable[[], None]) -> Iterator[None]:
    """LeRobot's writer, too, lets SVT-AV1 make this process real-time, which starves all others.

    Before each test as well: fixtures of modules run earlier.
    """
    _make_threads_ordinary()
    yield
    _make_threads_ordinary()


@pytest.fixture(scope="session")
def two_rooms(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    """A known two-room scene; see `tests.support.rooms`."""
    return write_two_rooms(tmp_path_factory.mktemp("two_rooms"))


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """Folder of real scans that may lie beside the repository."""
    if not SHARED_SCENES.is_dir():
        pytest.skip(f"no real scans at {SHARED_SCENES}")
    return SHARED_SCENES
