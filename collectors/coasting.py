"""How far a robot still goes after a stop: told by its gait's card, or measured on flat ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from .controllers import STOPPED, Coasting
from .locomotion import GaitPolicy
from .robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, RobotSpec

REST_M_S = 0.05  # a base slower than this is at rest
_STEP_S = POLICY_DECIMATION * TIMESTEP_S
_SETTLE_S, _WALK_S, _LONGEST_S = 0.4, 2.0, 1.5
_PHASES_S = (0.0, 0.13, 0.26)  # stops at different instants of a stride


def coasting_of(robot: RobotSpec, gait: Any) -> Coasting:
    """What the gait's card says (`evaluation["stopping"]`), else what is measured now."""
    told = gait.card.evaluation.get("stopping") if isinstance(gait, GaitPolicy) else None
    if told is not None:
        return Coasting(tuple(told["speed_m_s"]), tuple(told["distance_m_p50"]))
    return measure_coasting(robot, gait)


def measure_coasting(
    robot: RobotSpec, gait: Any, commands_m_s: Sequence[float] = (0.5, 1.0)
) -> Coasting:
    """Let the robot walk on flat ground, stop it, and see where it comes to rest.

    Takes some 20 s of simulated time. Stops that end in a fall do not count; a speed from which
    every stop does is left out.

    Args:
        robot: Robot to measure.
        gait: what moves its joints; see `world.Gait`.
        commands_m_s: speeds to stop from; those beyond the robot's limits are its limit.
    """
    model = robot.build_model()
    data = mujoco.MjData(model)
    handles = RobotHandles.find(robot, model)

    def run(seconds: float, command: tuple[float, float, float], until_rest: bool = False) -> None:
        for _ in range(round(seconds / _STEP_S)):
            data.ctrl[handles.actuators] = gait.act(data, command)
            mujoco.mj_step(model, data, nstep=POLICY_DECIMATION)
            velocity = data.qvel[handles.root_dof : handles.root_dof + 2]
            if until_rest and math.hypot(*velocity) < REST_M_S:
                return

    def place() -> np.ndarray:
        return data.qpos[handles.root_qpos : handles.root_qpos + 2].copy()

    most = robot.command_limits.vx_m_s[1]
    rows = []
    for command_m_s in sorted({min(command, most) for command in commands_m_s}):
        stops = []
        for phase_s in _PHASES_S:
            mujoco.mj_resetData(model, data)
            handles.spawn(data)
            mujoco.mj_forward(model, data)
            gait.reset()
            run(_SETTLE_S, STOPPED)
            run(_WALK_S - 0.5, (command_m_s, 0.0, 0.0))
            before = place()
            run(0.5 + phase_s, (command_m_s, 0.0, 0.0))
            stop = place()
            run(_LONGEST_S, STOPPED, until_rest=True)
            speed_m_s = float(np.linalg.norm(stop - before)) / (0.5 + phase_s)
            distance_m = float(np.linalg.norm(place() - stop))
            run(0.5, STOPPED)
            if handles.com_to_foot_m(data) > robot.fall.com_to_foot_m:
                stops.append((speed_m_s, distance_m))
        if stops:
            rows.append(tuple(np.mean(stops, axis=0).tolist()))
    rows.sort()
    return Coasting(tuple(s for s, _ in rows), tuple(d for _, d in rows))
