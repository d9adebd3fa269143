"""Stopping distance and turn lag of a robot: from its gait's card, or measured here."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from ....formats.core.rollout import REST_M_S
from ...controllers import STOPPED, Coasting, Pose
from ...controllers.interface import Command
from ...robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, RobotSpec
from . import GaitPolicy

_STEP_S = POLICY_DECIMATION * TIMESTEP_S
_SETTLE_S, _WALK_S, _LONGEST_S = 0.4, 1.5, 1.5
_PHASES_S = (0.0, 0.13, 0.26)  # stops at different instants of a stride
_TURN_RAD_S = 1.0


def coasting_of(robot: RobotSpec, gait: Any) -> Coasting:
    """Return the values of the gait's card (`evaluation["stopping"]`), or measure them now."""
    stopping = gait.card.evaluation.get("stopping") if isinstance(gait, GaitPolicy) else None
    if stopping is None:
        return measure_coasting(robot, gait)
    turn_lag_s = stopping.get("turn_lag_s")
    if turn_lag_s is None:
        turn_lag_s = measure_turn_lag(robot, gait)
    return _coasting(gait, stopping["speed_m_s"], stopping["distance_m_p50"], turn_lag_s)


def _coasting(
    gait: Any, speed_m_s: Sequence[float], distance_m: Sequence[float], turn_lag_s: float
) -> Coasting:
    """Take the lag of walking from the longest stop: what is left of it without braking."""
    brake_m_s2 = gait.card.gait.brakes[0] if isinstance(gait, GaitPolicy) else math.inf
    lag_s = 0.0
    if len(speed_m_s):
        lag_s = max(0.0, distance_m[-1] / speed_m_s[-1] - speed_m_s[-1] / (2.0 * brake_m_s2))
    return Coasting(tuple(speed_m_s), tuple(distance_m), lag_s, turn_lag_s)


def measure_coasting(
    robot: RobotSpec, gait: Any, commands_m_s: Sequence[float] = (0.5, 1.0)
) -> Coasting:
    """Measure stopping distances and turn lag of a robot on flat ground.

    Takes some 20 s of simulated time. Stops that end in a fall do not count; a speed from which
    every stop does is left out, and so is one at which the robot does not move.

    Args:
        gait: actuation of its joints; see `world.Gait`.
        commands_m_s: speeds to stop from; those beyond the robot's limits are its limit.
    """
    ground, limits = _FlatGround(robot, gait), robot.command_limits
    rows = []
    for command_m_s in sorted({min(each, limits.vx_m_s[1]) for each in commands_m_s}):
        stops = ground.stops((command_m_s, 0.0, 0.0))
        if stops:
            rows.append(np.mean([(stop.speed_m_s, stop.distance_m) for stop in stops], axis=0))
    rows = sorted((row for row in rows if row[0] > 0.0), key=lambda row: row[0])
    speed_m_s, distance_m = np.array(rows).reshape(-1, 2).T.tolist()
    return _coasting(gait, speed_m_s, distance_m, measure_turn_lag(robot, gait))


def measure_turn_lag(robot: RobotSpec, gait: Any) -> float:
    """Return the mean lag [s] of turns on the spot, as discrete actions make them."""
    turn = (0.0, 0.0, min(_TURN_RAD_S, robot.command_limits.yaw_rad_s[1]))
    turns = _FlatGround(robot, gait).stops(turn)
    lags_s = [stop.turned_rad / stop.turn_rad_s for stop in turns if stop.turn_rad_s > 0.1]
    return max(float(np.mean(lags_s)), 0.0) if lags_s else 0.0


@dataclass(frozen=True)
class _Stop:
    """A stop: speed and turn rate before it, displacement and angle from it to rest."""

    speed_m_s: float
    turn_rad_s: float
    distance_m: float
    turned_rad: float


class _FlatGround:
    """A robot on an endless floor."""

    def __init__(self, robot: RobotSpec, gait: Any) -> None:
        self._robot, self._gait = robot, gait.over(None) if isinstance(gait, GaitPolicy) else gait
        self._model = robot.build_model()
        self._data = mujoco.MjData(self._model)
        self._handles = RobotHandles.find(robot, self._model)

    def stops(self, command: Command) -> list[_Stop]:
        """Stop from a command at several instants of a stride; falls are left out."""
        data, handles, stops = self._data, self._handles, []
        for phase_s in _PHASES_S:
            mujoco.mj_resetData(self._model, data)
            handles.spawn(data)
            mujoco.mj_forward(self._model, data)
            self._gait.reset()
            self._run(_SETTLE_S, STOPPED)
            self._run(_WALK_S, command)
            before = self._pose()
            steady_s = 0.5 + phase_s
            self._run(steady_s, command)
            stop = self._pose()
            self._run(_LONGEST_S, STOPPED, until_rest=True)
            rest = self._pose()
            self._run(0.5, STOPPED)
            if handles.com_to_foot_m(data) <= self._robot.fall.com_to_foot_m:
                continue
            walked_m, turned_rad = _between(before, stop)
            distance_m, on_rad = _between(stop, rest)
            stops.append(_Stop(walked_m / steady_s, turned_rad / steady_s, distance_m, on_rad))
        return stops

    def _run(self, seconds: float, command: Command, until_rest: bool = False) -> None:
        data, dof = self._data, self._handles.root_dof
        for _ in range(round(seconds / _STEP_S)):
            data.ctrl[self._handles.actuators] = self._gait.act(data, command)
            mujoco.mj_step(self._model, data, nstep=POLICY_DECIMATION)
            slow = math.hypot(*data.qvel[dof : dof + 2]) < REST_M_S
            if until_rest and slow and abs(data.qvel[dof + 5]) < REST_M_S:
                return

    def _pose(self) -> Pose:
        x, y, _, w, i, j, k = self._data.qpos[self._handles.root_qpos :][:7].tolist()
        return Pose(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))


def _between(first: Pose, second: Pose) -> tuple[float, float]:
    """Return distance [m] and angle turned left [rad] between poses, less than half a turn."""
    turned = math.remainder(second.yaw_rad - first.yaw_rad, 2 * math.pi)
    return math.hypot(second.x_m - first.x_m, second.y_m - first.y_m), turned
