"""Sample, filter and align episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...formats.scene.bundle import load_bundle
from ...formats.vlnce.files import read_vlnce, write_episodes, write_vlnce
from ...trajectory_sampler.alignment import align_episodes
from ...trajectory_sampler.sampling import SampleConfig, sample_episodes
from ...trajectory_sampler.stairs import filter_stairs
from ..engine.work import ItemResult


@dataclass(frozen=True)
class SampleJob:
    """Sample trajectories in one repaired scene.

    Attributes:
        scene: its folder.
        out: episode file.
        config: how many, how long, for which robot.
        seed: of everything random.
    """

    scene: Path
    out: Path
    config: SampleConfig
    seed: int

    def run(self) -> ItemResult:
        """Sample one scene's episodes."""
        rng = np.random.default_rng(self.seed)
        result = sample_episodes(load_bundle(self.scene), self.config, rng)
        write_episodes(self.out, result.episodes)
        facts = {
            "episodes": len(result.episodes),
            "dropped": dict(result.dropped),
            "robot_radius_m": self.config.robot_radius_m,
        }
        return ItemResult(facts)


@dataclass(frozen=True)
class FilterJob:
    """Remove the episodes that climb stairs from a VLN-CE file.

    Attributes:
        source: VLN-CE file.
        out: VLN-CE file.
        max_step_m: largest rise between two points of the reference path [m].
    """

    source: Path
    out: Path
    max_step_m: float

    def run(self) -> ItemResult:
        """Write the episodes of `source` whose reference path climbs no stairs."""
        result = filter_stairs(read_vlnce(self.source), self.max_step_m)
        write_vlnce(self.out, result.kept)
        dropped = [[str(d.episode_id), d.reason] for d in result.dropped]
        facts = {"kept": len(result.kept.episodes), "dropped": len(dropped), "reasons": dropped}
        return ItemResult(facts)


@dataclass(frozen=True)
class AlignJob:
    """Align VLN-CE episodes to repaired scenes.

    Attributes:
        source: VLN-CE file.
        scenes: folders of repaired scenes by name.
        out: episode file.
        all_scenes: reject the episodes of other scenes instead of leaving them out.
    """

    source: Path
    scenes: Mapping[str, Path]
    out: Path
    all_scenes: bool = False

    def run(self) -> ItemResult:
        """Align the episodes of `source` that lie in `scenes`."""
        file = read_vlnce(self.source)
        if not self.all_scenes:
            wanted = tuple(e for e in file.episodes if e.scene_stem in self.scenes)
            file = replace(file, episodes=wanted)
        bundles = {name: load_bundle(path) for name, path in self.scenes.items()}
        result = align_episodes(file, bundles)
        write_episodes(self.out, result.episodes)
        facts = {
            "episodes": len(result.episodes),
            "rejected": [[str(name), reason] for name, reason in result.rejected],
            "moved": len(result.moved),
        }
        return ItemResult(facts)
