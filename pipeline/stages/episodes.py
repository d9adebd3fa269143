"""Stage `sample`, and the joining of episode files: what the robots will be asked to do."""

from __future__ import annotations

from pathlib import Path

from ...formats.core.episode import Episode
from ...formats.vlnce.files import read_episodes, write_episodes
from ...trajectory_sampler.sampling import SampleConfig
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..jobs.episodes import SampleJob


def sample_item(scene: Row, scenes: Path, out: Path, config: SampleConfig, seed: int) -> WorkItem:
    """Sample trajectories in one repaired scene into the episode file `out`."""
    job = SampleJob(scenes / scene.item, out, config, seed)
    return work_item("sample", scene.item, job, (out,), scene.key, config, seed)


def merge(parts: list[Path], out: Path) -> list[Episode]:
    """Join episode files into one, in order."""
    episodes = [episode for part in parts for episode in read_episodes(part)]
    write_episodes(out, episodes)
    return episodes
