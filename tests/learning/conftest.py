"""Walks of two rooms, as data and as episodes, shared by the tests of learned policies."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch

from tests.collectors.test_replay import make_episode
from tests.support.walked_data import write_walks
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.files import write_episodes
from vlnpe.rendering.camera.views import View, make_view


@dataclass(frozen=True)
class Walks:
    """Data and where it came from: two ways out of one place, which only the words tell apart."""

    root: Path
    scene: SceneBundle
    view: View
    episodes: list[Episode]
    rollouts: list[Rollout]


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Threads that wait for each other take long on a busy machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def walks(tmp_path_factory: pytest.TempPathFactory, two_rooms: SceneBundle) -> Walks:
    root = tmp_path_factory.mktemp("walks")
    goals = {"table": ((0.9, 2.3), "Go to the table."), "corner": ((1.0, 0.6), "Turn right.")}
    episodes = [
        replace(make_episode(two_rooms, (2.6, 2.0), goal, name=name, yaw=3.1), instruction=words)
        for name, (goal, words) in goals.items()
    ]
    view = make_view("ego", "vlnce", width_px=48, height_px=48)
    return Walks(root, two_rooms, view, episodes, write_walks(root, two_rooms, episodes, view))


@pytest.fixture
def run(walks: Walks, tmp_path: Path) -> Path:
    """A run folder with the scene and the episodes of the walks."""
    folder = tmp_path / "run"
    (folder / "episodes").mkdir(parents=True)
    (folder / "scenes").mkdir()
    (folder / "scenes" / "two_rooms").symlink_to(walks.scene.root)
    write_episodes(folder / "episodes" / "train.json.gz", walks.episodes)
    return folder
