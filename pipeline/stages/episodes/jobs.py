"""Sample, filter and align episodes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ....formats.scene.bundle import SceneBundle, load_bundle
from ....formats.vlnce.files import VlnceFile, read_vlnce, write_episodes, write_vlnce
from ....trajectory_sampler.config import CROSS_SHARE, SampleConfig
from ....trajectory_sampler.sampling import sample_episodes
from ....trajectory_sampler.vlnce.align import align_episodes
from ....trajectory_sampler.vlnce.align_config import AlignConfig
from ....trajectory_sampler.vlnce.stairs import StairRules, filter_stairs
from ...engine.work import ItemResult


@dataclass(frozen=True)
class SampleJob:
    """Sample trajectories in one repaired scene.

    Attributes:
        out: episode file, of all splits.
        config: how long, for which robot, …
        quotas: paths by split; empty asks for the count and split of `config`.
    """

    scene: Path
    out: Path
    config: SampleConfig
    seed: int
    quotas: Mapping[str, int] = field(default_factory=dict)

    def run(self) -> ItemResult:
        """Sample one scene's episodes."""
        rng = np.random.default_rng(self.seed)
        # Later stages find a scene by its folder's name, whatever the scan was called.
        bundle = replace(load_bundle(self.scene), scene_id=self.scene.name)
        result = sample_episodes(bundle, self.config, rng, self.quotas or None)
        write_episodes(self.out, result.episodes)
        facts = {
            "episodes": len(result.episodes),
            "requested": result.requested,
            "missing": result.missing,
            "gap_m": result.gap_m,
            "enough_at_m": result.enough_at_m,
            "dropped": dict(result.dropped),
            "robot_radius_m": self.config.robot_radius_m,
            "clear_for_m": result.clear_for_m,
        }
        if CROSS_SHARE[self.config.storeys]:
            facts["climb_height_m"] = self.config.climb_height_m
        return ItemResult(facts)


@dataclass(frozen=True)
class FilterJob:
    """Remove the episodes that climb stairs from a VLN-CE file.

    Attributes:
        scenes: folders of repaired scenes by name, for the rule `geometric`.
    """

    source: Path
    out: Path
    rules: StairRules
    scenes: Mapping[str, Path] = field(default_factory=dict)

    def run(self) -> ItemResult:
        """Write the episodes of `source` that climb no stairs."""
        file = read_vlnce(self.source)
        result = filter_stairs(file, self.rules, _bundles(self.scenes, file))
        write_vlnce(self.out, result.kept)
        dropped = [[str(d.episode_id), d.reason] for d in result.dropped]
        facts = {
            "split": file.split,
            "kept": len(result.kept.episodes),
            "dropped": len(dropped),
            "reasons": dropped,
            "bad": bad_episodes(file),
            # Pairs are (episodes, paths).
            "counts": asdict(result.counts),
        }
        return ItemResult(facts)


@dataclass(frozen=True)
class AlignJob:
    """Align VLN-CE episodes to repaired scenes."""

    source: Path
    scenes: Mapping[str, Path]
    out: Path
    config: AlignConfig

    def run(self) -> ItemResult:
        """Align the episodes of `source` that lie in `scenes`."""
        file = read_vlnce(self.source)
        here = tuple(e for e in file.episodes if e.scene_stem in self.scenes)
        file = replace(file, episodes=here)
        result = align_episodes(file, _bundles(self.scenes, file), self.config)
        write_episodes(self.out, result.episodes)
        facts = {
            "split": self.config.split or file.split,
            "episodes": len(result.episodes),
            "paths": result.paths,
            "rejected": [[str(name), reason] for name, reason in result.rejected],
            "bad": bad_episodes(file),
            "moved": len(result.moved),
            "changed": result.changed,
            "robot_radius_m": self.config.robot_radius_m,
        }
        if self.config.keep_climbable:
            facts["climb_height_m"] = self.config.climb_height_m
        return ItemResult(facts)


def _bundles(scenes: Mapping[str, Path], file: VlnceFile) -> dict[str, SceneBundle]:
    """Open the scenes, by name, that a file's episodes lie in."""
    named = {episode.scene_stem for episode in file.episodes}
    return {name: load_bundle(path) for name, path in scenes.items() if name in named}


def bad_episodes(file: VlnceFile) -> list[list[Any]]:
    """Return the index, name and reason of a file's unusable episodes, as JSON values."""
    return [[bad.index, bad.name, bad.reason] for bad in file.bad]
