"""Stage `sample`, and the joining of episode files: what the robots will be asked to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...formats.core.episode import Episode
from ...formats.scene.bundle import load_bundle
from ...formats.vlnce.files import read_episodes, write_episodes
from ...trajectory_sampler.sampling import SampleConfig, sample_episodes
from ..engine.keys import code_version, digest
from ..engine.ledger import Row
from ..engine.runner import ItemResult, WorkItem

SAMPLE_CODE = ("trajectory_sampler", "wayfinding", "formats", "pipeline/stages/episodes.py")


def sample_item(scene: Row, scenes: Path, out: Path, config: SampleConfig, seed: int) -> WorkItem:
    """Sample trajectories in one repaired scene into the episode file `out`."""
    key = digest("sample", scene.key, config, seed, code_version(*SAMPLE_CODE))
    arguments = (scenes / scene.item, out, config, seed)
    return WorkItem(scene.item, key, (out,), process_sample, arguments)


def process_sample(scene: Path, out: Path, config: SampleConfig, seed: int) -> ItemResult:
    """Sample one scene's episodes."""
    result = sample_episodes(load_bundle(scene), config, np.random.default_rng(seed))
    write_episodes(out, result.episodes)
    facts = {
        "episodes": len(result.episodes),
        "dropped": dict(result.dropped),
        "robot_radius_m": config.robot_radius_m,
    }
    return ItemResult(facts)


def merge(parts: list[Path], out: Path) -> list[Episode]:
    """Join episode files into one, in order."""
    episodes = [episode for part in parts for episode in read_episodes(part)]
    write_episodes(out, episodes)
    return episodes
