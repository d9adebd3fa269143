"""Stage `replay`: physics, no pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

from ...collectors.replay import ReplayConfig, replay_episode
from ...formats.episode import Episode
from ...formats.mcap.rollout import write_rollout
from ...formats.rollout import EndReason
from ...formats.scene_bundle import SceneBundle, load_bundle
from ..keys import code_version, digest
from ..ledger import Row
from ..run_folder import safe_name
from ..runner import ItemResult, WorkItem

STAGE = "replay"
CODE = (
    "collectors/robots",
    "collectors/locomotion",
    "collectors/physics",
    "collectors/controllers",
    "collectors/replay.py",
    "formats",
)


def items(
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    rollouts: Path,
    config: ReplayConfig,
) -> list[WorkItem]:
    """One item per episode of one robot under one controller."""
    code = code_version(*CODE)
    result = []
    for episode in episodes:
        name = f"{config.robot}/{config.controller}/{safe_name(episode.episode_id)}"
        key = digest(STAGE, episode, scenes[episode.scene_id].key, config, code)
        out = rollouts / f"{name}.mcap"
        scene = scenes_folder / episode.scene_id
        result.append(WorkItem(name, key, (out,), process, (scene, episode, config, out)))
    return result


def process(scene: Path, episode: Episode, config: ReplayConfig, out: Path) -> ItemResult:
    """Replay one episode."""
    rollout = replay_episode(_bundle(scene), episode, config)
    write_rollout(out, rollout)
    facts = {
        "episode": episode.episode_id,
        "scene": episode.scene_id,
        "robot": rollout.robot,
        "controller": rollout.controller,
        "end_reason": str(rollout.end_reason),
        "metrics": asdict(rollout.metrics),
    }
    return ItemResult(facts, failed=rollout.end_reason is not EndReason.SUCCESS)


@lru_cache(maxsize=2)
def _bundle(scene: Path) -> SceneBundle:
    return load_bundle(scene)
