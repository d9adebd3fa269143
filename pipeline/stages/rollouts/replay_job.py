"""Replay an episode in physics."""

import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ....collectors.locomotion.runtime.onnx_runtime import EXTRA
from ....collectors.physics import LevelModelConfig
from ....collectors.replay.replay import ReplayConfig, replay_in
from ....collectors.replay.world import World, open_world
from ....collectors.robots import RobotSpec
from ....formats.core.atomic import write_json
from ....formats.core.episode import Episode
from ....formats.core.errors import DivergedError
from ....formats.core.rollout import EndReason, Rollout
from ....formats.mcap.rollout import write_rollout
from ....formats.scene.bundle import load_bundle
from ....formats.vlnce.groups import instruction_count
from ...engine.work import ItemResult

TOUCHING = ("contact", "collision_target", "collision_start")  # events with an obstacle


@dataclass(frozen=True)
class Walker:
    """A robot, and how it replays episodes."""

    robot: RobotSpec
    config: ReplayConfig


@dataclass(frozen=True)
class ReplayJob:
    """Let a robot walk one episode and record it.

    Attributes:
        models: folder where compiled models are kept.
    """

    scene: Path
    episode: Episode
    walker: Walker
    models: Path
    out: Path

    @property
    def unused_libraries(self) -> frozenset[str]:
        """The libraries of a user's gait, which evaluate none of ours."""
        own = self.walker.robot.folder is not None
        return frozenset() if own else frozenset({EXTRA, "onnx"})

    def run(self) -> ItemResult:
        """Replay one episode.

        Raises:
            DivergedError: physics exploded; the last state lies beside where the rollout would be.
        """
        world = open_level(self.scene, self.episode, self.walker, self.models)
        rollout = replay_in(world, self.episode, self.walker.config)
        return store(rollout, self.scene.name, self.walker.config, self.out)


def store(rollout: Rollout, scene: str, config: ReplayConfig, out: Path) -> ItemResult:
    """Write a rollout and return its facts for the ledger.

    Raises:
        DivergedError: physics exploded; the last state lies beside where the rollout would be.
    """
    dump = out.with_suffix(".diverged.json")
    dump.unlink(missing_ok=True)
    if rollout.end_reason is EndReason.DIVERGED:
        out.unlink(missing_ok=True)  # of an earlier run
        last = {
            "episode": rollout.episode.episode_id,
            "scene": scene,
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
        "episode": rollout.episode.episode_id,
        "scene": scene,
        "split": rollout.episode.split,
        "instructions": instruction_count([rollout.episode]),
        "robot": rollout.robot,
        "controller": rollout.controller,
        "seed": config.seed,
        "state": config.state,
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
    """Return how discrete actions were executed; empty for controllers without any."""
    if config.controller != "speed":
        return {}
    return {"steps": config.speed.steps_per_action, "closed_loop": config.speed.end_on_displacement}


def open_level(scene: Path, episode: Episode, walker: Walker, models: Path) -> World:
    """Return the opened level of an episode; `models` keeps compiled models."""
    physics = walker.config.physics.for_episode(episode)
    return _opened(scene, episode.level, episode.staircase, walker.robot, physics, models)


# Opening a level takes as long as a tenth of an episode; a worker keeps the last ones.
@lru_cache(maxsize=4)
def _opened(
    scene: Path,
    level: int,
    staircase: int | None,
    robot: RobotSpec,
    physics: LevelModelConfig,
    models: Path,
) -> World:
    return open_world(load_bundle(scene), level, robot, None, physics, models, staircase)
