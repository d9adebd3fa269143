"""How well a gait obeys: velocities, standing, kicks."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..locomotion.policy import GaitPolicy
from ..robots import RobotSpec
from .trial import STEP_S, Conditions, Trial

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

    A robot that falls has velocity 0 from then on, which counts.

    Returns:
        Mean and worst errors [m/s, rad/s], falls, mean slip of feet on the ground [m/s], mean
        highest foot lift [m] of the walking ones, rate of the joint targets [rad/s, RMS].
    """
    n = len(commands)
    spread = np.zeros((n, 2)) if conditions.terrain.height_m is None else rng.uniform(-4, 4, (n, 2))
    heading = rng.uniform(-np.pi, np.pi, n)
    trial = Trial(policy, conditions, spread, heading, rng, watch_feet=True)
    velocity, slip, lift, rate = [], [], [], []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        if trial.time_s > warm_up_s:
            velocity.append(trial.velocity)
            slip.append(trial.slip)
            lift.append(trial.foot_clearance_m)
            rate.append(trial.target_rate)
    error = np.mean(velocity, axis=0) - commands
    linear, yaw = np.linalg.norm(error[:, :2], axis=1), np.abs(error[:, 2])
    walking = policy.card.gait.moving(commands) & ~trial.fallen
    return {
        "linear_error_mean_m_s": float(linear.mean()),
        "linear_error_max_m_s": float(linear.max()),
        "yaw_error_mean_rad_s": float(yaw.mean()),
        "yaw_error_max_rad_s": float(yaw.max()),
        "falls": int(trial.fallen.sum()),
        "commands": n,
        "foot_slip_m_s": _mean(np.array(slip)[:, walking]),
        "foot_lift_m": _mean(np.quantile(np.array(lift)[:, walking], 0.98, axis=0)),
        "target_rate_rad_s": float(np.sqrt(_mean(np.square(rate)))),
    }


def _mean(values: Array) -> float:
    """Mean of what is not NaN; NaN when nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


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
    """Walk, straight or in arcs that change every 4 s, with a kick every 3 s for 20 s."""
    conditions = Conditions.mixed(count, rng, push_m_s=speed_m_s)
    trial = Trial(policy, conditions, np.zeros((count, 2)), np.zeros(count), rng)
    limits = policy.robot.command_limits
    for _ in range(5):
        forward = rng.uniform(0.3, limits.vx_m_s[1], count)
        turn = rng.uniform(*limits.yaw_rad_s, count) * rng.integers(0, 2, count)
        commands = np.column_stack([forward, np.zeros(count), turn])
        for _ in range(round(4.0 / STEP_S)):
            trial.step(commands)
    return {"push_m_s": speed_m_s, "survived": float(1.0 - trial.fallen.mean()), "robots": count}


def posture(policy: GaitPolicy, rng: np.random.Generator, seconds: float = 6.0) -> dict[str, float]:
    """How a gait looks: straight walks of 0.3–1.0 m/s on level ground.

    Returns:
        Of the worst walk: roll from peak to peak within a gait cycle [°], median over cycles, and
        the height of a swinging foot's lowest sole [m], median over swings, of the highest and of
        the lowest walk.
    """
    speed = np.linspace(0.3, policy.robot.command_limits.vx_m_s[1], 8)
    n = len(speed)
    commands = np.column_stack([speed, np.zeros(n), np.zeros(n)]).astype(np.float64)
    trial = Trial(policy, Conditions.mixed(n, rng), np.zeros((n, 2)), np.zeros(n), rng)
    roll, lift = [], []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        if trial.time_s > 2.0:
            gravity = trial.state().gravity
            roll.append(np.rad2deg(np.arctan2(-gravity[:, 1], -gravity[:, 2])))
            lift.append(trial.foot_clearance_m)
    cycle = round(1.0 / (policy.card.gait.frequency_hz * STEP_S))
    whole = len(roll) // cycle * cycle
    rolls = np.array(roll[:whole]).reshape(-1, cycle, n)
    swings = np.array(lift[:whole]).reshape(-1, cycle, n, len(policy.robot.feet)).max(axis=1)
    heights = np.median(swings.mean(axis=2), axis=0)
    return {
        "roll_peak_to_peak_deg": float(np.median(np.ptp(rolls, axis=1), axis=0).max()),
        "clearance_max_m": float(heights.max()),
        "clearance_min_m": float(heights.min()),
        "falls": int(trial.fallen.sum()),
    }
