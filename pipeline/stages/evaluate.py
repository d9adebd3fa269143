"""Stage `evaluate`: episodes in closed loop, in a folder of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ...collectors.locomotion.policy import policy_files
from ...collectors.rendering.camera.views import View
from ...collectors.replay import ReplayConfig
from ...collectors.robots import get_robot
from ...formats.core.atomic import file_digest
from ...formats.core.episode import Episode
from ..engine.keys import digest
from ..engine.ledger import Row
from ..engine.run_folder import safe_name
from ..engine.work import WorkItem, work_item
from ..jobs.evaluate import EvaluateJob
from .replay import STAGE as STAGE  # its rollouts are rendered and exported like any others


def items(
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    root: Path,
    *,
    config: ReplayConfig,
    policy: str,
    identity: str,
    timeout_s: float,
    view: View,
) -> list[WorkItem]:
    """One item per episode.

    Args:
        episodes: what to walk.
        scenes: rows of the repair stage by scene id.
        scenes_folder: of the repaired scenes.
        root: output folder.
        config: the robot, its controller, and how.
        policy: name, or address of a policy server.
        identity: what the policy is now; see `policy_identity`.
        timeout_s: how long a policy server may take for one action.
        view: the camera that the policy sees through.
    """
    robot = get_robot(config.robot)
    who = digest(replace(config, robot=robot.name), robot.content_sha256)
    gait = [file_digest(path) for path in policy_files(robot)] if robot.policy_joints else None
    result = []
    for episode in episodes:
        name = f"{robot.name}/{config.controller}/{safe_name(episode.episode_id)}"
        out = root / f"{name}.mcap"
        scene = scenes_folder / episode.scene_id
        job = EvaluateJob(scene, episode, config, policy, timeout_s, view, root / "models", out)
        inputs = (episode, scenes[episode.scene_id].key, who, gait, identity, view)
        result.append(work_item("evaluate", name, job, (out,), *inputs))
    return result
