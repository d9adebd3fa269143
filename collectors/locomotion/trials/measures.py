"""Measures of a gait's obedience: velocities, standing, kicks, stops."""

from itertools import product
from typing import Any

import numpy as np

from ....formats.core.arrays import Array, Mask
from ...robots import POLICY_DECIMATION, RobotSpec
from ..runtime.coasting import measure_turn_lag
from ..runtime.policy import GaitPolicy
from .terrain import Terrain
from .trial import STEP_S, Conditions, Trial

# Of the stops.
SPEEDS_M_S = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TURNS_RAD_S = (-1.0, -0.5, 0.0, 0.5, 1.0)
REPEATS = 5  # of each command, stopped at different moments of the gait's cycle
WALK_S, WATCH_S = 3.0, 3.0
LONG_WATCH_S = 5.0  # a standing robot may topple slowly
REST_M_S = 0.05  # a base slower than this, and never faster again, is at rest
GOAL_S = 1.5  # it must be at rest by then


def command_grid(robot: RobotSpec, points: int = 3) -> Array:
    """Return (points³, 3) commands spanning the robot's limits."""
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
        highest foot lift [m] of the walking ones, rate of the joint targets [rad/s, RMS]; of an
        estimated state the errors of velocity [m/s, RMS] and attitude [°, RMS].
    """
    n = len(commands)
    spread = np.zeros((n, 2)) if conditions.terrain.height_m is None else rng.uniform(-4, 4, (n, 2))
    heading = rng.uniform(-np.pi, np.pi, n)
    trial = Trial(policy, conditions, spread, heading, rng, watch_feet=True)
    velocity, slip, lift, rate, estimate = [], [], [], [], []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        if trial.time_s > warm_up_s:
            velocity.append(trial.velocity)
            slip.append(trial.slip)
            lift.append(trial.foot_clearance_m)
            rate.append(trial.target_rate)
            estimate.append(trial.estimate_error)
    error = np.mean(velocity, axis=0) - commands
    linear, yaw = np.linalg.norm(error[:, :2], axis=1), np.abs(error[:, 2])
    walking = policy.card.gait.moving(commands) & ~trial.fallen
    estimated = {}
    if policy.estimates and not trial.fallen.all():
        wrong = np.sqrt(np.mean(np.square(estimate)[:, ~trial.fallen], axis=(0, 1))).tolist()
        estimated = {
            "estimate_error_m_s": wrong[0],
            "estimate_tilt_deg": float(np.rad2deg(wrong[1])),
        }
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
        **estimated,
    }


def _mean(values: Array) -> float:
    """Return the mean of what is not NaN; NaN when nothing is."""
    valid = values[np.isfinite(values)]
    return float(valid.mean()) if len(valid) else float("nan")


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


def standing_pushes(
    policy: GaitPolicy, count: int, speed_m_s: float, rng: np.random.Generator
) -> dict[str, float]:
    """Stand on level ground and get one kick; watch for 5 s.

    Returns:
        Share of robots `upright` at the end, and the median and 95th percentile of their
        displacement [m].
    """
    conditions = Conditions.mixed(count, rng)
    yaw_rad = rng.uniform(-np.pi, np.pi, count)
    trial = Trial(policy, conditions, np.zeros((count, 2)), yaw_rad, rng)
    start = trial.position_m[:, :2]
    trial.kick(trial.going, speed_m_s)
    for _ in range(round(LONG_WATCH_S / STEP_S)):
        trial.step(np.zeros((count, 3)))
    drift = np.linalg.norm(trial.position_m[:, :2] - start, axis=1)[~trial.fallen]
    return {
        "push_m_s": speed_m_s,
        "robots": count,
        "upright": float(1.0 - trial.fallen.mean()),
        "drift_m_p50": quantile(drift, 0.5),
        "drift_m_p95": quantile(drift, 0.95),
    }


def plate_stops(
    policy: GaitPolicy, plates: Terrain, count: int, rng: np.random.Generator
) -> dict[str, float]:
    """Walk over plates for about 3 s, then drop the command to zero; watch for 5 s."""
    commands = np.column_stack(
        [rng.choice(SPEEDS_M_S, count), np.zeros(count), rng.choice(TURNS_RAD_S, count)]
    )
    conditions = Conditions.mixed(count, rng, plates)
    fallen, *_ = _stop(policy, commands, conditions, rng, LONG_WATCH_S)
    return {"robots": count, "upright": float(1.0 - fallen.mean())}


def posture(policy: GaitPolicy, rng: np.random.Generator, seconds: float = 6.0) -> dict[str, float]:
    """Return how a gait looks: straight walks of 0.3–1.0 m/s on level ground.

    Returns:
        Of the worst walk: roll from peak to peak within a gait cycle [°], median over cycles;
        lateral speed of the base [m/s, RMS]; error of the mean speed forwards [m/s]. The height of
        a swinging foot's lowest sole [m], median over swings, of the highest and the lowest walk.
    """
    speed = np.linspace(0.3, policy.robot.command_limits.vx_m_s[1], 8)
    n = len(speed)
    commands = np.column_stack([speed, np.zeros(n), np.zeros(n)]).astype(np.float64)
    trial = Trial(policy, Conditions.mixed(n, rng), np.zeros((n, 2)), np.zeros(n), rng)
    roll, lift, velocity = [], [], []
    for _ in range(round(seconds / STEP_S)):
        trial.step(commands)
        if trial.time_s > 2.0:
            velocity.append(trial.velocity)
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
        "lateral_rms_m_s": float(np.sqrt(np.mean(np.square(velocity), axis=0)[:, 1]).max()),
        "speed_error_m_s": float(np.abs(np.mean(velocity, axis=0)[:, 0] - speed).max()),
        "clearance_max_m": float(heights.max()),
        "clearance_min_m": float(heights.min()),
        "falls": int(trial.fallen.sum()),
    }


def stops(
    policy: GaitPolicy, bumps: Terrain, rng: np.random.Generator, every: int = 1
) -> dict[str, Any]:
    """Walk for about 3 s, then drop the command to zero at once; watch for 3 s more.

    Every speed is combined with every turn rate and any moment of the gait's cycle: on level
    ground at friction 0.5 and 1.1, each with actions in time and 20 ms late, and on `bumps` with
    all of these mixed. Only each `every`th of the commands is tried.

    Returns:
        Robots and falls; share `upright` 3 s after the stop, of the worst condition; `rest_s_p99`
        [s], the 99th percentile of the time until a base is and stays slower than 0.05 m/s, of the
        worst condition (3 s for those who fall or never rest); share `rested` within 1.5 s, of all;
        and by `speed_m_s`, over all conditions and
        turn rates, the displacement from the stop to rest `distance_m_p50`, `distance_m_p95` [m]
        of those who stayed up, and `rest_s_p99_by_speed` [s]; `turn_lag_s` [s], see `Coasting`.
    """
    commands = np.array(
        [(v, 0.0, w) for v, w, _ in product(SPEEDS_M_S, TURNS_RAD_S, range(REPEATS))]
    )[::every]
    conditions = [
        Conditions(friction=friction, latency_substeps=substeps)
        for friction in (0.5, 1.1)
        for substeps in (0, POLICY_DECIMATION)
    ]
    conditions.append(Conditions.mixed(len(commands), rng, bumps))
    trials = [_stop(policy, commands, each, rng) for each in conditions]
    upright = [float(1.0 - fallen.mean()) for fallen, *_ in trials]
    rest_s = [_p99(rest) for _, rest, *_ in trials]
    fallen, rest, distance = (np.concatenate(parts) for parts in zip(*trials, strict=True))
    speed = np.tile(commands[:, 0], len(conditions))
    per_speed = [speed == v for v in SPEEDS_M_S]
    return {
        "robots": len(fallen),
        "falls": int(fallen.sum()),
        "upright": min(upright),
        "rest_s_p99": max(rest_s),
        "rested": float((rest <= GOAL_S).mean()),
        "speed_m_s": list(SPEEDS_M_S),
        "distance_m_p50": [quantile(distance[at & ~fallen], 0.5) for at in per_speed],
        "distance_m_p95": [quantile(distance[at & ~fallen], 0.95) for at in per_speed],
        "rest_s_p99_by_speed": [_p99(rest[at]) for at in per_speed],
        "turn_lag_s": measure_turn_lag(policy.robot, policy),
    }


def _stop(
    policy: GaitPolicy,
    commands: Array,
    conditions: Conditions,
    rng: np.random.Generator,
    watch_s: float = WATCH_S,
) -> tuple[Mask, Array, Array]:
    """Return which robots fell (N,), time to rest [s] and displacement [m]."""
    n = len(commands)
    spread = np.zeros((n, 2)) if conditions.terrain.height_m is None else rng.uniform(-4, 4, (n, 2))
    trial = Trial(policy, conditions, spread, rng.uniform(-np.pi, np.pi, n), rng)
    cycle_s = 1.0 / policy.card.gait.frequency_hz
    stop_s = WALK_S + cycle_s * rng.random(n)
    steps = round((WALK_S + cycle_s + watch_s) / STEP_S)
    where = np.empty((steps, n, 3))
    speed = np.empty((steps, n))
    for k in range(steps):
        stopped = trial.time_s >= stop_s
        trial.step(np.where(stopped[:, None], 0.0, commands))
        where[k] = trial.poses[:, 1]
        speed[k] = np.linalg.norm(trial.state().linear_velocity_m_s[:, :2], axis=1)
    time_s = STEP_S * np.arange(1, steps + 1)[:, None]
    # What happens more than `watch_s` after a robot's stop belongs to no stop.
    watched = (time_s > stop_s) & (time_s <= stop_s + watch_s + 1e-6)
    moving = watched & (speed >= REST_M_S)
    last = np.where(moving, time_s, stop_s).max(axis=0)
    rest = np.where(trial.fallen, watch_s, last - stop_s)
    first = np.argmax(watched, axis=0)
    end = np.minimum(first + round(watch_s / STEP_S), steps - 1)
    moved = where[end, np.arange(n)] - where[np.maximum(first - 1, 0), np.arange(n)]
    distance = np.linalg.norm(moved[:, :2], axis=1)
    return trial.fallen.copy(), rest, distance


def _p99(values: Array) -> float:
    """Return the 99th percentile, a value that occurs."""
    return float(np.quantile(values, 0.99, method="higher"))


def quantile(values: Array, share: float) -> float:
    """Return a quantile, NaN of nothing."""
    return float(np.quantile(values, share)) if len(values) else float("nan")
