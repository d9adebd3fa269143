"""How well a gait walks: the table that goes into its card.

`python -m vlnpe.collectors.locomotion.evaluate aliengo` prints it for the installed policy.
"""

from __future__ import annotations

import json
import logging
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from ...formats.atomic import atomic_file
from ..robots import RobotSpec, get_robot
from .card import save_card
from .commands import sample_commands
from .policy import GaitPolicy
from .terrain import noise_terrain
from .trial import STEP_S, Conditions, Trial

log = logging.getLogger(__name__)
Array = NDArray[np.float64]


def command_grid(robot: RobotSpec, points: int = 3) -> Array:
    """(points³, 3) commands spanning the robot's limits."""
    limits = robot.command_limits
    axes = [np.linspace(*r, points) for r in (limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s)]
    return np.array(list(product(*axes)))


def velocity_errors(
    policy: GaitPolicy,
    commands: Array,
    conditions: Conditions,
    rng: np.random.Generator,
    seconds: float = 6.0,
    warm_up_s: float = 2.0,
) -> dict[str, float]:
    """Hold each command and compare the mean velocity after `warm_up_s` with it.

    Returns:
        Mean and worst errors [m/s, rad/s], falls, mean foot slip [m/s], mean highest foot lift [m]
        of the walking ones, rate of the joint targets [rad/s, RMS], vertical shaking.
    """
    n = len(commands)
    spread = np.zeros((n, 2)) if conditions.terrain.height_m is None else rng.uniform(-4, 4, (n, 2))
    trial = Trial(policy, conditions, spread, rng.uniform(-np.pi, np.pi, n), rng)
    velocity, slip, lift, rate = [], [], [], []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        if trial.time_s > warm_up_s:
            velocity.append(trial.velocity)
            slip.append(trial.slip)
            lift.append(trial.foot_clearance_m)
            rate.append(trial.target_rate)
    up = ~trial.fallen
    error = np.mean(velocity, axis=0)[up] - commands[up]
    linear, yaw = np.linalg.norm(error[:, :2], axis=1), np.abs(error[:, 2])
    walking = policy.card.gait.moving(commands) & up
    return {
        "linear_error_mean_m_s": float(linear.mean()),
        "linear_error_max_m_s": float(linear.max()),
        "yaw_error_mean_rad_s": float(yaw.mean()),
        "yaw_error_max_rad_s": float(yaw.max()),
        "falls": int(trial.fallen.sum()),
        "commands": n,
        "foot_slip_m_s": float(np.nanmean(np.array(slip)[:, walking])),
        "foot_lift_m": float(np.quantile(np.array(lift)[:, walking], 0.98, axis=0).mean()),
        "target_rate_rad_s": float(np.sqrt(np.mean(np.square(rate)))),
    }


def standing(policy: GaitPolicy, seconds: float = 5.0) -> dict[str, float]:
    """Stand still: drift over the time, base height, and how much the joints move."""
    trial = Trial(policy, Conditions(), np.zeros((1, 2)), np.zeros(1), np.random.default_rng(0))
    start, speeds = trial.position_m, []
    for _ in range(round(seconds / STEP_S)):
        trial.step(np.zeros((1, 3)))
        speeds.append(trial.state().joint_rad_s.copy())
    return {
        "drift_m": float(np.linalg.norm((trial.position_m - start)[0, :2])),
        "base_height_m": float(trial.position_m[0, 2]),
        "joint_speed_rms_rad_s": float(np.sqrt(np.mean(np.square(speeds)))),
        "falls": int(trial.fallen.sum()),
    }


def pushes(
    policy: GaitPolicy, count: int, speed_m_s: float, rng: np.random.Generator
) -> dict[str, float]:
    """Walk under changing commands with a kick every 3 s for 20 s."""
    conditions = Conditions(push_m_s=speed_m_s)
    trial = Trial(policy, conditions, np.zeros((count, 2)), np.zeros(count), rng)
    for _ in range(5):
        commands = sample_commands(rng, count, policy.robot.command_limits, 1.0)
        for _ in range(round(4.0 / STEP_S)):
            trial.step(commands)
    return {"push_m_s": speed_m_s, "survived": float(1.0 - trial.fallen.mean()), "robots": count}


def random_path(rng: np.random.Generator, length_m: float = 12.0) -> Array:
    """A polyline from the origin with turns of up to 90°, sampled every 5 cm, (P, 2)."""
    points, heading, position, left = [], 0.0, np.zeros(2), length_m
    while left > 0.05:
        stretch = min(left, rng.uniform(1.0, 3.0))
        steps = np.arange(0.05, stretch + 1e-9, 0.05)
        points.append(position + steps[:, None] * (np.cos(heading), np.sin(heading)))
        position = points[-1][-1]
        left -= stretch
        heading += rng.uniform(-np.pi / 2, np.pi / 2)
    return np.concatenate(points)


def follow_paths(
    policy: GaitPolicy, count: int, conditions: Conditions, rng: np.random.Generator
) -> dict[str, float]:
    """Follow random 12 m paths by pure pursuit at up to 0.8 m/s; reached = within 0.25 m."""
    paths = [random_path(rng) for _ in range(count)]
    trial = Trial(policy, conditions, np.zeros((count, 2)), np.zeros(count), rng)
    ahead = np.zeros(count, dtype=int)
    reached = np.zeros(count, dtype=bool)
    cross: list[float] = []
    for _ in range(round(40.0 / STEP_S)):
        xy, yaw = trial.position_m[:, :2], trial.yaw_rad
        command = np.zeros((count, 3))
        for i, path in enumerate(paths):
            # The nearest point may only move forward, so that crossings do not confuse it.
            window = path[ahead[i] : ahead[i] + 20]
            distance = np.linalg.norm(window - xy[i], axis=1)
            ahead[i] += int(distance.argmin())
            reached[i] |= bool(np.linalg.norm(path[-1] - xy[i]) < 0.25 and not trial.fallen[i])
            if reached[i] or trial.fallen[i]:
                continue
            cross.append(float(distance.min()))
            target = path[min(ahead[i] + 8, len(path) - 1)] - xy[i]
            error = np.arctan2(target[1], target[0]) - yaw[i]
            error = np.arctan2(np.sin(error), np.cos(error))
            command[i] = 0.8 * max(0.0, np.cos(error)) ** 2, 0.0, 2.5 * error
        trial.step(command)
        if (reached | trial.fallen).all():
            break
    return {
        "paths": count,
        "reached": float(reached.mean()),
        "falls": int((trial.fallen & ~reached).sum()),
        "distance_to_path_mean_m": float(np.mean(cross)),
    }


def evaluation_table(policy: GaitPolicy, seed: int = 1234, scale: float = 1.0) -> dict[str, Any]:
    """The whole table; `scale` < 1 takes fewer robots. Terrain and seeds are not training's."""
    rng = np.random.default_rng(seed)
    grid = command_grid(policy.robot)
    many = max(8, round(200 * scale))
    rough = {f"{cm}cm": Conditions(noise_terrain(rng, 0.01 * cm)) for cm in (4, 6)}
    table: dict[str, Any] = {"seed": seed, "standing": standing(policy)}
    for name, conditions in {
        "flat": Conditions(),
        "flat_20ms_late": Conditions(latency_substeps=4),
        "flat_friction_0.5": Conditions(friction=0.5),
        "noise_4cm": rough["4cm"],
    }.items():
        table[f"grid_{name}"] = velocity_errors(policy, grid, conditions, rng)
    table["paths_flat"] = follow_paths(policy, many, Conditions(), rng)
    for name, conditions in rough.items():
        table[f"paths_noise_{name}"] = follow_paths(policy, many, conditions, rng)
    table["pushes"] = pushes(policy, many, 0.5, rng)
    return table


def publish(robot: RobotSpec, source: Path, target: Path) -> None:
    """Evaluate the policy in `source`, complete its card and copy both files to `target`."""
    policy = GaitPolicy.load(robot, source)
    card = replace(policy.card, evaluation=evaluation_table(policy))
    with atomic_file(target / f"{robot.name}.onnx") as temporary:
        shutil.copyfile(source / f"{robot.name}.onnx", temporary)
    save_card(card, target / f"{robot.name}.json")
    log.info("%s", json.dumps(card.evaluation, indent=2))


def main(robot: Annotated[str, tyro.conf.Positional], scale: float = 1.0) -> None:
    """Print the evaluation table of the installed policy of `robot`."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    policy = GaitPolicy.load(get_robot(robot))
    log.info("%s", json.dumps(evaluation_table(policy, scale=scale), indent=2))


if __name__ == "__main__":
    tyro.cli(main)
