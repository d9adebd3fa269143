"""A scene of three episodes in the layout."""

import shutil
from pathlib import Path

import pytest

from tests.formats.internnav.layouts import make_unit
from vlnpe.formats.internnav.layout import scan_name, scene_name
from vlnpe.formats.internnav.writer import SceneEpisode, share_instructions, write_scene
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.formats.vlnce.vocabulary import Vocabulary


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("units")
    return [make_unit(root, number, 2.0 + number) for number in range(3)]


@pytest.fixture(scope="module")
def written(units: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A root with one scene of three episodes, which tests do not change."""
    tasks = share_instructions([read_episode_unit(u) for u in units])
    words = Vocabulary.of(text for own in tasks for text in own)
    episodes = [SceneEpisode(u, own) for u, own in zip(units, tasks, strict=True)]
    root = tmp_path_factory.mktemp("written")
    scene = scene_name("two_rooms")
    out = root / scan_name("h1", "path") / scene
    assert write_scene(out, episodes, words, every_frame=True) == 9 + 13 + 17
    return root


@pytest.fixture
def layout(written: Path, tmp_path: Path) -> Path:
    """A copy of its own for each test."""
    return shutil.copytree(written, tmp_path / "n1")
