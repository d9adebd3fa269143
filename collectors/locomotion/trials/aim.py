"""Calibrate commands, so that a gait walks as fast as commanded.

A trained gait falls short of some commands in a way that repeats: fast ones, or a turn while
walking. Measured once, this is undone by a polynomial from the velocity wanted to the one asked
for. Its monomials respect the robot's left-right symmetry.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ....formats.core.arrays import I64, Array, Mask
from ...robots import CommandLimits
from ...robots.parts import UNLIMITED
from ..runtime.gait import GaitClock
from ..runtime.policy import GaitPolicy
from .trial import STEP_S, Conditions, Trial

POINTS, SECONDS, WARM_UP_S, ROUNDS = 5, 5.0, 2.0, 5
# Late actions cost more than early ones gain: between none and 20 ms, nearer to the latter.
LATENCY_SUBSTEPS = 3
STRIDE = 0.7  # share of the remaining error that a round corrects


def command_bounds(
    limits: CommandLimits, margin: float = 1.0, beyond: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Return least and greatest vx, vy and yaw (3, 2): the limits times `margin`, plus `beyond`."""
    bounds = margin * np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s])
    return bounds + np.asarray(beyond)[:, None] * (-1.0, 1.0)


def calibrated(policy: GaitPolicy) -> GaitPolicy:
    """Return the policy with its gait calibrated, within the commands of its last training phase.

    A card whose training says `aim_beyond` may be asked for that much more than the robot's limits:
    a gait that only walks too slowly follows commands that it never saw.
    """
    training = policy.card.training
    phase = training["phases"][-1]
    beyond = training.get("aim_beyond", phase.get("command_beyond", (0, 0, 0)))
    most = command_bounds(policy.robot.command_limits, phase["command_margin"], beyond)
    return policy.changed(policy.robot, replace(policy.card, gait=aimed(policy, most)))


def aimed(policy: GaitPolicy, most: Array, points: int = POINTS, rounds: int = ROUNDS) -> GaitClock:
    """Return the policy's gait with commands calibrated on flat ground.

    Every command of a grid inside the robot's limits is corrected, round after round, by what the
    mean velocity still lacks; the polynomial is fitted to the last round.

    Args:
        policy: policy to calibrate; its present calibration is ignored.
        most: (3, 2) least and greatest vx, vy and yaw that it was trained with.
        points: number of grid points along each axis.
        rounds: number of rounds of correction.
    """
    bounds = command_bounds(policy.robot.command_limits)
    target = np.array(list(product(*(np.linspace(low, high, points) for low, high in bounds))))
    target = target[policy.card.gait.moving(target)]
    plain = replace(policy.card.gait, aim=(), aim_limits=())
    command = target.copy()
    for _ in range(rounds):
        reached, up = _mean_velocity(policy, plain, command)
        step = np.where(up[:, None], STRIDE * (target - reached), 0.0)
        command = np.clip(command + step, most[:, 0], most[:, 1])
    aim = _fit(target, command - target, plain.tables.factors)
    return replace(
        plain,
        aim=tuple(tuple(row) for row in aim.tolist()),
        aim_limits=tuple((float(low), float(high)) for low, high in most),
    )


def _mean_velocity(policy: GaitPolicy, gait: GaitClock, commands: Array) -> tuple[Array, Mask]:
    """Return mean velocities (N, 3) under constant commands (N, 3), and who is still up (N,)."""
    n = len(commands)
    free = policy.changed(
        replace(policy.robot, command_limits=UNLIMITED), replace(policy.card, gait=gait)
    )
    rng = np.random.default_rng(0)
    conditions = replace(Conditions.mixed(n, rng), latency_substeps=LATENCY_SUBSTEPS)
    trial = Trial(free, conditions, np.zeros((n, 2)), np.zeros(n), rng)
    velocity = []
    for _ in range(round(SECONDS / STEP_S)):
        trial.step(commands)
        if trial.time_s > WARM_UP_S:
            velocity.append(trial.velocity)
    return np.mean(velocity, axis=0), ~trial.fallen


def _fit(target: Array, extra: Array, factors: I64) -> Array:
    """Return coefficients (3, K) of monomials of targets (N, 3) that give what to add (N, 3)."""
    terms = _monomials(target, factors)
    # Under a reflection of y, vy and yaw change sign; vx must not, and they must.
    odd = _monomials(np.array([[1.0, -1.0, -1.0]]), factors)[0] < 0.0
    coefficients = np.zeros((3, terms.shape[1]))
    for axis in range(3):
        allowed = odd if axis else ~odd
        solution, *_ = np.linalg.lstsq(terms[:, allowed], extra[:, axis], rcond=None)
        coefficients[axis, allowed] = solution
    return coefficients


def _monomials(command: Array, factors: I64) -> Array:
    """Return (N, K) products of those components of (N, 3) commands that `factors` (K, 3) name."""
    return np.column_stack([command, np.ones(len(command))])[:, factors].prod(axis=2)
