"""Gaits under the product's own controllers on open ground: paths, and discrete actions alone."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from ....formats.core.arrays import Array
from ....formats.core.frames import wrap_angle
from ....formats.core.geometry import distances_to_path
from ....formats.core.rollout import FORWARD_STEP_M, STEPS, Action
from ....formats.scene.freemap import Freemap
from ....formats.scene.grid import GridSpec
from ...controllers import STOPPED, Controller, PathConfig, Pose, SpeedConfig, Task
from ...controllers.path import PathController
from ...controllers.speed import SpeedController
from ...physics.outcome import OutcomeConfig
from ..runtime.coasting import coasting_of
from ..runtime.policy import GaitPolicy
from .measures import quantile
from .trial import STEP_S, Conditions, Trial

CONTROL_HZ = 100  # `Trial` reads two poses per step of 20 ms
REST_S = 2.5  # a robot must still stand so long after it stopped


def random_path(rng: np.random.Generator, length_m: float = 12.0) -> Array:
    """Return corners (P, 2) of a polyline from the origin: legs of 1–3 m, turns of up to 90°."""
    points: list[Array] = [np.zeros(2)]
    heading, left = 0.0, length_m
    while left > 0.05:
        stretch = min(left, rng.uniform(1.0, 3.0))
        points.append(points[-1] + stretch * np.array([math.cos(heading), math.sin(heading)]))
        left -= stretch
        heading += rng.uniform(-np.pi / 2, np.pi / 2)
    return np.array(points)


@cache
def open_ground(half_m: float = 30.0, cell_m: float = 0.25) -> Freemap:
    """Return a map of a free square around the origin."""
    cells = round(2 * half_m / cell_m)
    grid = GridSpec((-half_m, -half_m), cell_m, cells, cells)
    return Freemap(grid, np.zeros(grid.shape, np.float32), np.ones(grid.shape, dtype=bool))


def tasks_along(policy: GaitPolicy, paths: Sequence[Array]) -> list[Task]:
    """Return the tasks of following corners (P, 2) on open ground, as a replay would set them."""
    robot = policy.robot
    coasting = coasting_of(robot, policy)
    return [
        Task(
            reference_xy_m=path,
            goal_xy_m=path[-1],
            freemap=open_ground(),
            radius_m=robot.footprint_radius_m,
            limits=robot.command_limits,
            goal_tolerance_m=OutcomeConfig().success_m,
            coasting=coasting,
        )
        for path in paths
    ]


@dataclass(frozen=True)
class StartedAction:
    """A discrete action at its start: when [s] and from which pose (3,) x, y [m], heading [rad]."""

    action: Action
    time_s: float
    pose: Array


class Drivers:
    """One controller for each robot of a trial, asked as often as it wants to be.

    Attributes:
        done_s: (N,) when each controller was done [s]; inf before.
        actions: discrete actions started so far, robot by robot; each ends where the next starts.
    """

    def __init__(self, controllers: Sequence[Controller], trial: Trial) -> None:
        self.controllers, self.trial = controllers, trial
        self._commands = np.zeros((len(controllers), 3))
        self._every = [CONTROL_HZ // c.rate_hz for c in controllers]
        self._tick = 0
        self.done_s = np.full(len(controllers), np.inf)
        self.actions: list[list[StartedAction]] = [[] for _ in controllers]
        self._ask(trial.poses[:, 1])

    def step(self) -> None:
        """Advance the trial by 20 ms, asking the controllers at both of its poses."""
        self.trial.step(self._commands)
        self.trial.leave(self.trial.time_s > self.done_s + REST_S)
        for half in (0, 1):
            self._tick += 1
            self._ask(self.trial.poses[:, half])

    def _ask(self, poses: Array) -> None:
        now_s = self._tick / CONTROL_HZ
        for i in np.flatnonzero(self.trial.going & np.isinf(self.done_s)).tolist():
            if self._tick % self._every[i]:
                continue
            decision = self.controllers[i].step(now_s, Pose(*poses[i].tolist()))
            self._commands[i] = decision.command
            if decision.action is not None:
                self.actions[i].append(StartedAction(decision.action, now_s, poses[i].copy()))
            if decision.done:
                self._commands[i] = STOPPED
                self.done_s[i] = now_s


def follow_paths(
    policy: GaitPolicy,
    count: int,
    conditions: Conditions,
    rng: np.random.Generator,
    by_speed: bool = False,
) -> dict[str, float]:
    """Follow random 12 m paths under move-along-path, or move-by-speed, as it is by default.

    Reached means what success means in a replay: it stopped, and 2.5 s later still stands
    within the goal's tolerance.
    """
    paths = [random_path(rng) for _ in range(count)]
    trial = Trial(policy, conditions, np.zeros((count, 2)), np.zeros(count), rng)
    outcome = OutcomeConfig()
    tasks = tasks_along(policy, paths)
    controllers: list[PathController | SpeedController] = [
        SpeedController(task, SpeedConfig()) if by_speed else PathController(task, PathConfig())
        for task in tasks
    ]
    drivers = Drivers(controllers, trial)
    nominal_s = np.array([c.nominal_s for c in controllers])
    off: list[float] = []
    while trial.going.any():
        drivers.step()
        late = np.isinf(drivers.done_s) & (trial.time_s > outcome.timeout_factor * nominal_s)
        trial.leave(late)
        if round(trial.time_s / STEP_S) % 10 == 0:
            off += [
                float(distances_to_path(trial.position_m[i : i + 1, :2], paths[i])[0])
                for i in np.flatnonzero(trial.going)
            ]
    goals = np.array([p[-1] for p in paths])
    near = np.linalg.norm(trial.position_m[:, :2] - goals, axis=1) <= outcome.success_m
    reached = near & np.isfinite(drivers.done_s) & ~trial.fallen
    return {
        "paths": count,
        "reached": float(reached.mean()),
        "falls": int(trial.fallen.sum()),
        "distance_to_path_mean_m": float(np.mean(off)) if off else math.nan,
        "seconds_mean": float(np.mean(drivers.done_s[reached])) if reached.any() else math.nan,
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
    drivers = Drivers([SpeedController(task, config) for task in tasks_along(policy, paths)], trial)
    while trial.going.any():
        drivers.step()
        trial.leave(np.array([len(started) > actions for started in drivers.actions]))
    kinds, moved, seconds = displacements(drivers.actions)
    nominal = np.reshape([STEPS[kind] for kind in kinds], (-1, 3))
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
        "turn_p5_deg": quantile(turned_deg, 0.05),
        "turn_p95_deg": quantile(turned_deg, 0.95),
        "reversals": _mean(np.array([_reverses(*p) for s in drivers.actions for p in pairwise(s)])),
        "turns": _mean(~steps),
        "seconds_per_action": _mean(seconds),
    }


def displacements(started: list[list[StartedAction]]) -> tuple[list[Action], Array, Array]:
    """Return kinds, displacements (K, 3) in the actions' start frames, and durations (K,) [s]."""
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
    return quantile(values, 0.9)
