"""Discrete labels: where executing them ends, how much they turn; whether the expert arrives."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vlnpe.collectors.controllers import Expert, Pose, Task
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import ROBOTS, RobotSpec
from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.frames import quat_to_yaw
from vlnpe.formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action, EndReason, Rollout
from vlnpe.formats.rendered.discrete_steps import discrete_steps, execute, total_turning
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.trajectory_sampler.config import SampleConfig
from vlnpe.trajectory_sampler.sampling import sample_episodes

EPISODES = 24
CONTROLLERS = ("path", "speed")
SUCCESS_M = 0.25
TURNS = (Action.LEFT, Action.RIGHT)


@dataclass(frozen=True)
class Walk:
    """One rollout and its discrete steps.

    Attributes:
        arrived: the robot stopped within `SUCCESS_M` of the goal.
        apart_m: between the robot's end and that of the executed steps.
        turning_rad: total turning of the steps minus the robot's.
        reversals: turns that follow a turn of the other sense, among the executed actions.
    """

    arrived: bool
    apart_m: float
    turning_rad: float
    reversals: int

    @staticmethod
    def of(rollout: Rollout) -> "Walk":
        at = rollout.frame_samples(4)
        yaw = np.unwrap(quat_to_yaw(rollout.quat_wxyz[at])).astype(np.float64)
        poses = np.column_stack([rollout.position_world_m[at, :2], yaw]).astype(np.float64)
        steps = discrete_steps(poses)
        end = execute(steps.action, poses[0])[-1]
        turned = TURN_STEP_RAD * float(np.isin(steps.action, TURNS).sum())
        turns = [span.action for span in rollout.actions if span.action in TURNS]
        return Walk(
            rollout.end_reason is EndReason.SUCCESS,
            math.dist(end[:2], poses[-1, :2]),
            turned - total_turning(yaw),
            sum(a != b for a, b in pairwise(turns)),
        )


def report(scenes: Iterable[SceneBundle]) -> str:
    """Replay episodes of every scene with every robot and return a Markdown section."""
    robots = [robot for robot in ROBOTS.values() if robot.joints]
    rows = []
    for bundle in scenes:
        episodes = _episodes(bundle, max(robot.footprint_radius_m for robot in robots))
        for robot in robots:
            arrivals = sum(agent_arrives(bundle, episode, robot) for episode in episodes)
            for controller in CONTROLLERS:
                walks = walked(robot, controller, bundle, episodes)
                rows.append(_row((bundle.scene_id, robot.name, controller), walks, arrivals))
    return "\n".join(
        [
            "## Discrete labels",
            "",
            f"Up to {EPISODES} episodes a scene, falls included. *Apart*: distance between the end "
            "of the executed discrete steps and the robot's. *Turning*: difference of total "
            "turning, swings of at least 15°. *Agent*: an ideal agent that asks the expert at its "
            "own poses.",
            "",
            "| scene | robot | controller | arrived | apart, median and 95 % [m] | turning, median "
            "and 95 % [°] | reversals | agent arrived |",
            "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |",
            *rows,
            "",
        ]
    )


def _row(names: tuple[str, ...], walks: list[Walk], arrivals: int) -> str:
    apart = np.quantile([w.apart_m for w in walks], [0.5, 0.95])
    turning = np.rad2deg(np.quantile([abs(w.turning_rad) for w in walks], [0.5, 0.95]))
    reversals = sum(w.reversals for w in walks)
    return (
        f"| {' | '.join(names)} | {sum(w.arrived for w in walks)} of {len(walks)} "
        f"| {apart[0]:.2f}, {apart[1]:.2f} | {turning[0]:.1f}, {turning[1]:.1f} "
        f"| {reversals or ''} | {arrivals} of {len(walks)} |"
    )


def _episodes(bundle: SceneBundle, radius_m: float) -> list[Episode]:
    config = SampleConfig(count=EPISODES, robot_radius_m=radius_m)
    return sample_episodes(bundle, config, np.random.default_rng(0)).episodes


def walked(
    robot: RobotSpec, controller: str, bundle: SceneBundle, episodes: list[Episode]
) -> list[Walk]:
    """Replay the episodes, opening each level once."""
    worlds = {k: open_world(bundle, k, robot) for k in {e.level for e in episodes}}
    config = ReplayConfig(robot=robot.name, controller=controller)
    return [Walk.of(replay_in(worlds[e.level], e, config)) for e in episodes]


def agent_arrives(bundle: SceneBundle, episode: Episode, robot: RobotSpec) -> bool:
    """Return whether an agent of exact actions that asks the expert stops at the goal."""
    goal = episode.goal_position_world_m[:2]
    task = Task(
        reference_xy_m=episode.reference_path_world_m[:, :2],
        goal_xy_m=goal,
        freemap=bundle.freemap(episode.level),
        radius_m=robot.footprint_radius_m,
        limits=robot.command_limits,
        goal_tolerance_m=SUCCESS_M,
    )
    expert = Expert(task)
    x, y, _ = episode.start_position_world_m.tolist()
    yaw = episode.start_yaw_rad
    for _ in range(500):
        action = expert.next_action(Pose(x, y, yaw))
        if action is Action.STOP:
            return math.dist((x, y), goal) <= SUCCESS_M
        if action is Action.FORWARD:
            x += FORWARD_STEP_M * math.cos(yaw)
            y += FORWARD_STEP_M * math.sin(yaw)
        else:
            yaw += TURN_STEP_RAD if action is Action.LEFT else -TURN_STEP_RAD
    return False
