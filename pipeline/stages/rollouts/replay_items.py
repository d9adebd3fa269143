"""Stage `replay`: physics, no pixels."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ....collectors.controllers import SpeedConfig, get_controller
from ....collectors.locomotion.runtime.policy import policy_files, stairs_files
from ....collectors.locomotion.state import State
from ....collectors.replay.replay import ReplayConfig
from ....collectors.robots import RobotSpec
from ....formats.core.atomic import file_digest
from ....formats.core.episode import Episode
from ...engine.ledger import Ledger, Row
from ...engine.run_folder import file_names
from ...engine.work import WorkItem, digest, work_item
from .replay_job import ReplayJob, Walker, actions

STAGE = "replay"
STUCK_ACTIONS = 50


def walker(
    robot: RobotSpec, controller: str, seed: int, timing: SpeedConfig, state: State = "true"
) -> Walker:
    """Return how a robot replays episodes.

    `timing` matters to the controller `speed` alone, and `state` to a robot that walks.
    """
    if robot.drive is not None or get_controller(controller).teleports:
        state = "true"
    plain = ReplayConfig(robot=robot.name, controller=controller, seed=seed, state=state)
    if controller != "speed":
        return Walker(robot, plain)
    # VLN-PE calls stuck what gets nowhere in 50 actions; in closed loop these have no fixed length.
    if timing.end_on_displacement:
        outcome = replace(plain.outcome, stuck_actions=STUCK_ACTIONS)
    else:
        outcome = replace(plain.outcome, stuck_steps=STUCK_ACTIONS * timing.steps_per_action)
    return Walker(robot, replace(plain, speed=timing, outcome=outcome))


def items(
    episodes: Sequence[Episode],
    scenes: Mapping[str, Row],
    scenes_folder: Path,
    rollouts: Path,
    models: Path,
    walker: Walker,
    label: str = "",
) -> list[WorkItem]:
    """Return one item per episode of one robot under one controller.

    Args:
        models: folder where compiled models are kept.
        label: see `label_of`; by default the controller's name.
    """
    who, result = identity(walker), []
    for episode, name in zip(episodes, walk_names(episodes, walker, label), strict=True):
        out = rollouts / f"{name}.mcap"
        job = ReplayJob(scenes_folder / episode.scene_id, episode, walker, models, out)
        inputs = (episode, scenes[episode.scene_id].key, *who)
        result.append(work_item(STAGE, name, job, (out,), *inputs))
    return result


def identity(walker: Walker) -> tuple[ReplayConfig, str, list[str] | None]:
    """Return the parts of a robot and its settings that decide a rollout, for keys.

    A user's own robot is identified by the content of its folder, not by its place; each robot's
    rollouts depend on its own gait alone.
    """
    robot = walker.robot
    files = (*policy_files(robot), *filter(Path.is_file, stairs_files(robot)))
    gait = [file_digest(path) for path in files] if robot.policy_joints else None
    return walker.config, robot.content_sha256, gait


def gait_digest(walker: Walker) -> str | None:
    """Return the digest of the gait that walks; None where none does."""
    *_, gait = identity(walker)
    return digest(gait) if gait and not get_controller(walker.config.controller).teleports else None


def label_of(ledger: Ledger, config: ReplayConfig) -> str:
    """Return the name under which rollouts of a robot and its settings are kept.

    That is the controller's, unless an earlier run in the folder used it for another seed, state or
    other discrete actions: then what differs follows, so that neither replaces the other.
    """
    now = _setting(config.seed, config.state, actions(config))
    taken: dict[str, dict[str, object]] = {}
    for row in ledger.all_rows(STAGE):
        owner, label, _ = row.item.split("/", 2)
        if owner == config.robot and row.facts.get("controller") == config.controller:
            state = row.facts.get("state", "true")
            taken[label] = _setting(row.facts.get("seed", 0), state, row.facts.get("actions") or {})
    same = [label for label, setting in taken.items() if setting == now]
    if same or config.controller not in taken:
        return same[0] if same else config.controller
    first = taken[config.controller]
    changed = [f"{name}-{now[name]}" for name in sorted(now) if now[name] != first.get(name)]
    return "-".join([config.controller, *changed])


def _setting(seed: int, state: State, actions: Mapping[str, Any]) -> dict[str, object]:
    setting: dict[str, object] = {"seed": seed, "state": state}
    if actions:
        loop = "closed" if actions["closed_loop"] else "open"
        setting |= {"loop": loop, "steps": actions["steps"]}
    return setting


def walk_names(episodes: Sequence[Episode], walker: Walker, label: str = "") -> list[str]:
    """Return the name of each episode's item: robot, label, and `item_names`."""
    folder = f"{walker.robot.name}/{label or walker.config.controller}"
    return [f"{folder}/{name}" for name in item_names(episodes)]


def item_names(episodes: Sequence[Episode]) -> list[str]:
    """Return a file name of its own for each episode: its id, where that is unique.

    Episodes of the same id have their split before it, those of the same split their scene, too,
    and those of the same scene are counted.
    """
    count = Counter(episode.episode_id for episode in episodes)
    labels = [
        e.episode_id if count[e.episode_id] == 1 else f"{e.split}-{e.episode_id}" for e in episodes
    ]
    for further in (lambda e, label: f"{e.scene_id}-{label}", None):
        count = Counter(labels)
        seen: Counter[str] = Counter()
        for k, label in enumerate(labels):
            if count[label] > 1:
                seen[label] += 1
                labels[k] = further(episodes[k], label) if further else f"{label}~{seen[label]}"
    return file_names(labels)
