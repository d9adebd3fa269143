"""The scripts in `examples/` run unchanged."""

import re
import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.episodes import episode_along
from tests.support.rollouts import make_rollout
from vlnpe.collectors.controllers import CONTROLLERS
from vlnpe.evaluation.observation import Observation
from vlnpe.evaluation.policies.remote import RemotePolicy
from vlnpe.evaluation.policy import Assignment
from vlnpe.formats.lerobot import assemble_dataset
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.wayfinding.planning import plan_path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
Run = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Run]:
    """Run a script as `python examples/NAME ARGUMENTS` does and return what it prints."""
    registered = set(CONTROLLERS)

    def run(name: str, *arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        capsys.readouterr()
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    yield run
    for name in CONTROLLERS.keys() - registered:
        del CONTROLLERS[name]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tests.support.lerobot_data import write_unit

    root = tmp_path_factory.mktemp("dataset")
    units = [write_unit(root, make_rollout(s, n), n) for n, s in enumerate((2.0, 3.0))]
    assemble_dataset(units, root / "data", provenance={}, licence="mit", title="two walks")
    return root / "data"


def test_load_dataset(run: Run, dataset: Path) -> None:
    lines = run("load_dataset.py", dataset).splitlines()
    assert [line.split(":")[0] for line in lines] == ["episode 0", "episode 1"]
    assert re.search(r"rgb \(1, (\d+), (\d+), 3\), depth \(1, \1, \2\)", lines[0])


def test_load_dataset_says_what_is_no_dataset(tmp_path: Path) -> None:
    script = [sys.executable, str(EXAMPLES / "load_dataset.py"), str(tmp_path)]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "not a LeRobot dataset" in done.stderr and "DATASET" in done.stderr


def test_own_robot(run: Run, tmp_path: Path) -> None:
    assert "myrobot: My own robot" in run("own_robot.py", tmp_path / "myrobot")


def test_own_policy_answers_over_a_socket(tmp_path: Path) -> None:
    script = [sys.executable, str(EXAMPLES / "own_policy.py"), "0"]
    with subprocess.Popen(script, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            policy = RemotePolicy(server.stdout.readline().split()[-1])
            policy.reset(Assignment("e1", "house", "Go on.", "aliengo", "speed"))
            for step, depth_m, action in ((0, 3.0, 1), (1, 0.5, 2), (2, 0.0, 2), (30, 3.0, 0)):
                rgb, depth = np.zeros((6, 6, 3), np.uint8), np.full((6, 6), depth_m, np.float32)
                state = (np.zeros(3), np.zeros(33), -1, step)
                assert policy.act(Observation(rgb, depth, "Go on.", *state)) == action
            assert policy.version == "keep-clear 1" and policy.said[0] == "told: Go on."
            policy.close()
        finally:
            server.kill()


def test_own_controller_reaches_a_goal_in_the_same_room(
    run: Run, two_rooms: SceneBundle, tmp_path: Path
) -> None:
    path = plan_path(two_rooms.freemap(0), (1.0, 1.0), (3.0, 2.0), 0.3)
    assert path is not None
    episode = replace(episode_along(path), start_yaw_rad=0.0)
    write_episodes(tmp_path / "episodes.json.gz", [episode])
    text = run("own_controller.py", two_rooms.root, tmp_path / "episodes.json.gz")
    assert text.startswith("e0: success"), text


def test_convert(run: Run, dataset: Path, tmp_path: Path) -> None:
    run("convert.py", dataset, 1, tmp_path / "one.mcap")
    assert (tmp_path / "one.mcap").read_bytes().startswith(b"\x89MCAP")


def test_custom_camera(run: Run, two_rooms: SceneBundle, tmp_path: Path) -> None:
    text = run("custom_camera.py", two_rooms.root, tmp_path / "seen.png")
    assert Image.open(tmp_path / "seen.png").size == (160, 120)
    # From (1, 2) through the doorway at x = 4 to the inner face of the east wall, x = 8.
    assert "centre 7.0" in text


def test_overview(run: Run, tmp_path: Path) -> None:
    for name, size in (
        ("scenes/home/before.png", (600, 800)),
        ("scenes/home/after.png", (600, 800)),
        ("report/strips/aliengo.jpg", (1500, 600)),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", size).save(tmp_path / name)
    run("overview.py", tmp_path, tmp_path / "overview.jpg")
    assert Image.open(tmp_path / "overview.jpg").size == (450 + 450 + 954, 600)
