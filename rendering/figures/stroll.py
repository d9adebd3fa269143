"""A robot that walks straight ahead on a flat floor, under nothing but its own gait."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from ...collectors.locomotion.runtime.drives import gait_for
from ...collectors.locomotion.runtime.policy import GaitPolicy
from ...collectors.robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, RobotSpec
from ...formats.core.arrays import Array
from ...formats.core.errors import InputError

SPEED_M_S = 0.8
SETTLE_S, WARM_S = 1.0, 3.0
CYCLES = 2


@dataclass(frozen=True)
class Stroll:
    """Record of two gait cycles, or of two turns of the wheels.

    Attributes:
        time_s: (T,) from 0 on, every physics step [s].
        position_m, quat_wxyz: (T, 3), (T, 4) of the base.
        joint_rad: (T, J).
        caption: speed and cycle in words.
    """

    time_s: Array
    position_m: Array
    quat_wxyz: Array
    joint_rad: Array
    caption: str


def stroll(robot: RobotSpec) -> Stroll:
    """Walk along +x at `SPEED_M_S` or the robot's limit, and record two cycles of a steady gait.

    Raises:
        InputError: the robot has no joints to move with.
        FileFormatError: its policy's files are missing or broken.
    """
    gait, speed_m_s = gait_for(robot), min(SPEED_M_S, robot.command_limits.vx_m_s[1])
    if robot.drive is not None:
        period = 2 * math.pi * robot.drive.wheel_radius_m / speed_m_s
        verb, cycles = "driving", "two turns of the wheels"
    elif isinstance(gait, GaitPolicy):
        period = 1.0 / gait.card.gait.frequency_hz
        verb, cycles = "walking", f"two cycles of {period:.2f} s"
    else:
        raise InputError(f"{robot.name} has no joints: it is placed and cannot walk")
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    mujoco.mj_forward(model, data)
    # A whole number of cycles first, so that the record begins where a cycle does.
    warm = math.ceil(WARM_S / period) * period
    start = round((SETTLE_S + warm) / TIMESTEP_S)
    steps = start + round(CYCLES * period / TIMESTEP_S) + 1
    rows = np.empty((steps, model.nq))
    for step in range(steps):
        if step % POLICY_DECIMATION == 0:
            command = (speed_m_s if step * TIMESTEP_S >= SETTLE_S else 0.0, 0.0, 0.0)
            data.ctrl[handles.actuators] = gait.act(data, command)
        rows[step] = data.qpos
        mujoco.mj_step(model, data)
    q, recorded = handles.root_qpos, rows[start:]
    position = recorded[:, q : q + 3] - np.array([recorded[0, q], 0.0, 0.0])
    time_s = TIMESTEP_S * np.arange(len(recorded), dtype=np.float64)
    speed = float(np.hypot(*(position[-1] - position[0])[:2])) / time_s[-1]
    return Stroll(
        time_s=time_s,
        position_m=position,
        quat_wxyz=recorded[:, q + 3 : q + 7],
        joint_rad=recorded[:, handles.joint_qpos],
        caption=f"{verb} at {speed:.2f} m/s · {cycles}",
    )
