"""A robot walking straight on a flat floor, under nothing but its own gait."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ..formats.errors import InputError
from .drives import gait_for
from .locomotion.policy import GaitPolicy
from .robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, RobotSpec

Array = NDArray[np.float64]

SPEED_M_S = 0.8
SETTLE_S, WARM_S = 1.0, 3.0
CYCLES = 2


@dataclass(frozen=True)
class Stroll:
    """Two cycles of a gait, or two turns of the wheels.

    Attributes:
        time_s: (T,) from 0 on, every physics step [s].
        position_m, quat_wxyz: (T, 3), (T, 4) of the base.
        joint_rad: (T, J).
        cycles: what a cycle is, in words.
    """

    time_s: Array
    position_m: Array
    quat_wxyz: Array
    joint_rad: Array
    cycles: str


def stroll(robot: RobotSpec, speed_m_s: float = SPEED_M_S) -> Stroll:
    """Walk along +x and record two cycles once the gait is steady.

    Args:
        robot: whom.
        speed_m_s: commanded, at most what the robot may be asked for.

    Raises:
        InputError: the robot has no joints to move with.
        FileFormatError: its policy's files are missing or broken.
    """
    if not robot.joints:
        raise InputError(f"{robot.name} has no joints: it is placed and cannot walk")
    gait = gait_for(robot)
    speed = min(speed_m_s, robot.command_limits.vx_m_s[1])
    if robot.drive is not None:
        period, cycles = 2 * math.pi * robot.drive.wheel_radius_m / speed, "two turns of the wheels"
    elif isinstance(gait, GaitPolicy):
        period = 1.0 / gait.card.gait.frequency_hz
        cycles = f"two cycles of {period:.2f} s"
    else:
        raise AssertionError("a robot with joints has wheels or a policy")
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data, 0.0, 0.0, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    # A whole number of cycles first, so that the record begins where a cycle does.
    warm = math.ceil(WARM_S / period) * period
    start = round((SETTLE_S + warm) / TIMESTEP_S)
    steps = start + round(CYCLES * period / TIMESTEP_S) + 1
    rows = np.empty((steps, model.nq))
    for step in range(steps):
        if step % POLICY_DECIMATION == 0:
            moving = step * TIMESTEP_S >= SETTLE_S
            command = (speed if moving else 0.0, 0.0, 0.0)
            data.ctrl[handles.actuators] = gait.act(data, command)
        rows[step] = data.qpos
        mujoco.mj_step(model, data)
    q, recorded = handles.root_qpos, rows[start:]
    return Stroll(
        time_s=TIMESTEP_S * np.arange(len(recorded), dtype=np.float64),
        position_m=recorded[:, q : q + 3] - np.array([recorded[0, q], 0.0, 0.0]),
        quat_wxyz=recorded[:, q + 3 : q + 7],
        joint_rad=recorded[:, handles.joint_qpos],
        cycles=cycles,
    )
