"""Fixtures shared by all tests."""

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, settings

from tests.support.runs.work import InlineWorkers
from tests.support.scenes.rooms import write_two_rooms
from tests.support.signals import let_children_have_defaults
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.video.scheduling import ordinary_threads
from vlnpe.pipeline.execution.attempts import keep_mujoco_from_writing

# Speed belongs to benchmarks: a busy machine must not fail a test.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")
let_children_have_defaults()

SHARED_SCENES = Path(__file__).resolve().parents[2] / "shared" / "scenes"

# What the core environment lacks: libraries of extras and of the group `dev`. A file that imports
# one of the first is left out, whereas tests skip themselves where one of the others is missing.
LIBRARIES = (
    "torch|lerobot|lerobot_doctor|datasets|accelerate|onnx|onnxruntime|rsl_rl|huggingface_hub"
    "|open3d|s3fs|moto|pyvista|setuptools|gymnasium|rosbags"
)
HIDDEN = {*LIBRARIES.split("|"), "msgpack", "ray", "safetensors", "selenium", "submitit"}
NOT_CORE = re.compile(
    rf"^\s*(?:import|from) (?:{LIBRARIES}"
    r"|vlnpe\.evaluation\.(?:env|http|remote|server)"
    r"|vlnpe\.collectors\.locomotion\.training\.(?:env|export|mirror|train))\b"
    r"|vlnpe\.learning|vlnpe\.evaluation\.learned|vlnpe\.pipeline\.ablation\.(?:cells|plan)",
    re.MULTILINE,
)
SUPPORT = re.compile(r"^from tests\.(support[\w.]+) import \(?\s*(\w+)", re.MULTILINE)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--core", action="store_true", help="leave out test files that need more than the core"
    )


class CoreFinder(PathFinder):
    """Finds, in any environment, no more than the core environment holds."""

    @classmethod
    def find_spec(
        cls,
        fullname: str,
        path: Sequence[str] | None = None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        found = super().find_spec(fullname, path, target)
        # A test may write a stand-in.
        installed = found and "site-packages" in (found.origin or "")
        return None if installed and fullname.partition(".")[0] in HIDDEN else found


def pytest_configure(config: pytest.Config) -> None:
    """With `--core`, hide the other libraries, which tests would use where they are installed."""
    if config.getoption("--core"):
        sys.meta_path[sys.meta_path.index(PathFinder)] = CoreFinder


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out, with `--core`, test files whose text imports anything beyond the core.

    And folders whose `conftest.py` does, for pytest imports that one with the first file.
    """
    if collection_path.is_dir():
        collection_path /= "conftest.py"
    if not (config.getoption("--core") and collection_path.suffix == ".py"):
        return None
    if not collection_path.is_file():
        return None
    source = collection_path.read_text()
    tests = Path(__file__).parent
    sources = [source]
    for module, name in SUPPORT.findall(source):
        path = tests.joinpath(*module.split("."))
        file = path / name if path.is_dir() else path
        sources.append(file.with_suffix(".py").read_text())
    return True if any(NOT_CORE.search(text) for text in sources) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start files with long tests first: workers take whole files, and should end together."""
    slow, chain = (
        {item.path for item in items if item.get_closest_marker(mark)} for mark in ("slow", "chain")
    )
    items.sort(key=lambda item: (item.path not in slow, item.path not in chain))


@pytest.fixture(scope="session")
def _make_threads_ordinary() -> Iterator[Callable[[], None]]:
    with ordinary_threads() as restore:
        yield restore


@pytest.fixture(autouse=True)
def _threads_stay_ordinary(_make_threads_ordinary: Callable[[], None]) -> Iterator[None]:
    """Undo real-time scheduling, which LeRobot's writer lets SVT-AV1 set, starving other processes.

    Before each test as well: fixtures of modules run earlier.
    """
    _make_threads_ordinary()
    yield
    _make_threads_ordinary()


@pytest.fixture(autouse=True, scope="session")
def no_mujoco_log() -> None:
    """Keep MuJoCo, whose warnings some tests provoke, from writing MUJOCO_LOG.TXT where we are."""
    import mujoco  # noqa: F401 - so that it is loaded

    keep_mujoco_from_writing()


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands work in this process: a worker takes seconds to start."""
    monkeypatch.setattr("vlnpe.pipeline.execution.settings.Workers", InlineWorkers)


@pytest.fixture(scope="module")
def offline() -> Iterator[None]:
    """Keep LeRobot from looking for a dataset on the Hub, and its encoders from using all cores."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setenv("OMP_NUM_THREADS", "1")
        yield


@pytest.fixture(scope="session")
def two_rooms(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    """A known two-room scene; see `tests.support.scenes.rooms`."""
    return write_two_rooms(tmp_path_factory.mktemp("two_rooms"))


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """Folder of real scans that may lie beside the repository."""
    if not SHARED_SCENES.is_dir():
        pytest.skip(f"no real scans at {SHARED_SCENES}")
    return SHARED_SCENES
