"""Stage `replay`: physics, no pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ...collectors.controllers import SpeedConfig
from ...collectors.replay import ReplayConfig, replay_in
from ...collectors.robots import get_robot
from ...collectors.world import World, open_world
from ...formats.core.atomic import write_json
from ...formats.core.episode import Episode
from ...formats.core.errors import VlnpeError
from ...formats.core.rollout import EndReason
from ...formats.mcap.rollout import write_rollout
from ...formats.scene.bundle import load_bundle
from ..engine.keys import code_version, digest
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.runner import ItemResult, WorkItem

STAGE = "replay"
TOUCHING = ("contact", "collision_target", "collision_start")  # events with an obstacle
CODE = ("collectors", "wayfinding", "formats", "pipeline/stages/replay.py")


def config(robot: str, controller: str, seed: int, actions: SpeedConfig) -> ReplayConfig:
    """Settings of a replay; those of discrete actions matter to the controller `speed` alone."""
    plain = ReplayConfig(robot=robot, controller=controller, seed=seed)
    return replace(plain, speed=actions) if controller == "speed" else plain


def items(
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    rollouts: Path,
    models: Path,
    config: ReplayConfig,
) -> list[WorkItem]:
    """One item per episode of one robot under one controller.

    Args:
        episodes: what to walk.
        scenes: rows of the repair stage by scene id.
        scenes_folder: of the repaired scenes.
        rollouts: output folder.
        models: folder where compiled models are kept.
        config: the robot, its controller, and how.
    """
    robot = get_robot(config.robot)
    code = digest(code_version(*CODE), version("mujoco"))
    # A user's own robot is known by what is in its folder, not by where that lies.
    who = digest(replace(config, robot=robot.name), robot.content_sha256)
    result = []
    for episode in episodes:
        name = f"{robot.name}/{config.controller}/{safe_name(episode.episode_id)}"
        key = digest(STAGE, episode, scenes[episode.scene_id].key, who, code)
        out = rollouts / f"{name}.mcap"
        arguments = (scenes_folder / episode.scene_id, episode, config, models, out)
        result.append(WorkItem(name, key, (out,), process, arguments))
    return result


def process(
    scene: Path, episode: Episode, config: ReplayConfig, models: Path, out: Path
) -> ItemResult:
    """Replay one episode.

    Raises:
        DivergedError: physics exploded; the last state lies beside where the rollout would be.
    """
    dump = out.with_suffix(".diverged.json")
    dump.unlink(missing_ok=True)
    rollout = replay_in(_world(scene, episode.level, config, models), episode, config)
    if rollout.end_reason is EndReason.DIVERGED:
        out.unlink(missing_ok=True)  # of an earlier run
        last = {
            "episode": episode.episode_id,
            "scene": scene.name,
            "time_s": rollout.metrics.duration_s,
            "events": [asdict(event) for event in rollout.events],
            "facts": rollout.facts,
            "config": asdict(config),
        }
        write_json(dump, last)
        after_s = rollout.metrics.duration_s
        raise DivergedError(f"physics diverged after {after_s:.2f} s; its last state: {dump.name}")
    write_rollout(out, rollout)
    end = str(rollout.end_reason)
    facts = {
        "episode": episode.episode_id,
        "scene": scene.name,
        "robot": rollout.robot,
        "controller": rollout.controller,
        "seed": config.seed,
        "actions": actions(config),
        "end_reason": end,
        "detail": next((e.detail for e in reversed(rollout.events) if e.kind == end), ""),
        "contacts": sum(event.kind in TOUCHING for event in rollout.events),
        # JSON knows no infinity: an unreachable goal has no distance.
        "metrics": {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in asdict(rollout.metrics).items()
        },
    }
    return ItemResult(facts, failed=rollout.end_reason is not EndReason.SUCCESS)


def actions(config: ReplayConfig) -> dict[str, Any]:
    """How discrete actions were carried out; empty for controllers that know none."""
    if config.controller != "speed":
        return {}
    return {
        "steps": config.speed.steps_per_action,
        "closed_loop": config.speed.end_on_displacement,
    }


class DivergedError(VlnpeError):
    """Physics produced NaN or exploded."""


# Opening a level takes as long as a tenth of an episode; a worker keeps the last ones.
@lru_cache(maxsize=4)
def _world(scene: Path, level: int, config: ReplayConfig, models: Path) -> World:
    robot = get_robot(config.robot)
    return open_world(load_bundle(scene), level, robot, None, config.physics, models)
