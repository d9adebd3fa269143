"""What discrete actions displace a walking robot by, each one against its 0.25 m or 15°."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...formats.core.frames import wrap_angle
from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from ..controllers import SpeedConfig
from ..controllers.speed import SpeedController
from ..locomotion.policy import GaitPolicy
from .driven import Drivers, StartedAction, random_path, task_along
from .trial import Conditions, Trial

Array = NDArray[np.float64]

NOMINAL = {
    Action.FORWARD: (FORWARD_STEP_M, 0.0, 0.0),
    Action.LEFT: (0.0, 0.0, TURN_STEP_RAD),
    Action.RIGHT: (0.0, 0.0, -TURN_STEP_RAD),
}


def action_errors(
    policy: GaitPolicy,
    config: SpeedConfig,
    count: int,
    conditions: Conditions,
    rng: np.random.Generator,
    actions: int = 100,
) -> dict[str, float]:
    """Let the expert lead along random paths by `actions` discrete actions under move-by-speed.

    An action's displacement is that of the base between its start and the next one's, in the frame
    of its start; its error is what differs from 0.25 m ahead or 15° on the spot. So what a body
    coasts on counts against the next action.

    Returns:
        90th percentiles of all actions' errors in position [m] and heading [°], and of steps and
        turns alone; mean step [m] and turn [°]; share of turns, and of turns right after one
        to the other side; mean time of an action [s]; falls.
    """
    paths = [random_path(rng, FORWARD_STEP_M * actions) for _ in range(count)]
    heading = rng.uniform(-np.pi / 2, np.pi / 2, count)
    trial = Trial(policy, conditions, np.zeros((count, 2)), heading, rng)
    drivers = Drivers(
        [SpeedController(task_along(policy.robot, path), config) for path in paths], trial
    )
    while trial.going.any():
        drivers.step()
        trial.leave(np.array([len(started) > actions for started in drivers.actions]))
    kinds, moved, seconds = displacements(drivers.actions)
    nominal = np.reshape([NOMINAL[kind] for kind in kinds], (-1, 3))
    position = np.linalg.norm((moved - nominal)[:, :2], axis=1)
    turned = np.rad2deg(np.abs(wrap_angle(moved[:, 2] - nominal[:, 2])))
    steps = np.array([kind is Action.FORWARD for kind in kinds], dtype=bool)
    sign = np.sign(nominal[:, 2])
    turned_deg = np.rad2deg(sign * moved[:, 2])[~steps]
    return {
        "robots": count,
        "actions": len(kinds),
        "falls": int(trial.fallen.sum()),
        "position_p90_m": _p90(position),
        "heading_p90_deg": _p90(turned),
        "step_position_p90_m": _p90(position[steps]),
        "step_heading_p90_deg": _p90(turned[steps]),
        "turn_position_p90_m": _p90(position[~steps]),
        "turn_heading_p90_deg": _p90(turned[~steps]),
        "step_mean_m": _mean(moved[steps, 0]),
        "turn_mean_deg": _mean(turned_deg),
        "turn_p5_deg": _quantile(turned_deg, 0.05),
        "turn_p95_deg": _quantile(turned_deg, 0.95),
        "reversals": _mean(np.array([_reverses(*p) for s in drivers.actions for p in pairwise(s)])),
        "turns": _mean(~steps),
        "seconds_per_action": _mean(seconds),
    }


def displacements(started: list[list[StartedAction]]) -> tuple[list[Action], Array, Array]:
    """Kinds, displacements (K, 3) in each action's start frame, and durations (K,) [s]."""
    kinds, moved, seconds = [], [], []
    for sequence in started:
        for a, b in pairwise(sequence):
            dx, dy = (b.pose - a.pose)[:2]
            cosine, sine = math.cos(a.pose[2]), math.sin(a.pose[2])
            turn = math.remainder(b.pose[2] - a.pose[2], 2 * math.pi)
            kinds.append(a.action)
            moved.append((cosine * dx + sine * dy, cosine * dy - sine * dx, turn))
            seconds.append(b.time_s - a.time_s)
    return kinds, np.reshape(moved, (-1, 3)), np.array(seconds)


def _reverses(first: StartedAction, second: StartedAction) -> bool:
    return {first.action, second.action} == {Action.LEFT, Action.RIGHT}


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else math.nan


def _p90(values: Array) -> float:
    return _quantile(values, 0.9)


def _quantile(values: Array, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else math.nan
