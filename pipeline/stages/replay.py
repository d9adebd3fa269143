"""Stage `replay`: physics, no pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ...collectors.controllers import SpeedConfig
from ...collectors.locomotion.policy import policy_files
from ...collectors.replay import ReplayConfig
from ...collectors.robots import get_robot
from ...formats.core.atomic import file_digest
from ...formats.core.episode import Episode
from ..engine.keys import digest
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.work import WorkItem, work_item
from ..jobs.replay import ReplayJob

STAGE = "replay"
STUCK_ACTIONS = 50


def config(robot: str, controller: str, seed: int, actions: SpeedConfig) -> ReplayConfig:
    """Settings of a replay; those of discrete actions matter to the controller `speed` alone."""
    plain = ReplayConfig(robot=robot, controller=controller, seed=seed)
    if controller != "speed":
        return plain
    if actions.end_on_displacement:
        return replace(plain, speed=actions)
    # VLN-PE calls stuck what gets nowhere in 50 actions; in closed loop these have no fixed length.
    outcome = replace(plain.outcome, stuck_steps=STUCK_ACTIONS * actions.steps_per_action)
    return replace(plain, speed=actions, outcome=outcome)


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
    # A user's own robot is known by what is in its folder, not by where that lies.
    who = digest(replace(config, robot=robot.name), robot.content_sha256)
    # Each robot's replays depend on its own gait alone.
    gait = [file_digest(path) for path in policy_files(robot)] if robot.policy_joints else None
    result = []
    for episode in episodes:
        name = f"{robot.name}/{config.controller}/{safe_name(episode.episode_id)}"
        out = rollouts / f"{name}.mcap"
        job = ReplayJob(scenes_folder / episode.scene_id, episode, config, models, out)
        inputs = (episode, scenes[episode.scene_id].key, who, gait)
        result.append(work_item(STAGE, name, job, (out,), *inputs))
    return result
