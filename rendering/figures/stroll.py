"""A robot that walks, turns or stands on a flat floor, under nothing but its own gait."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from ...collectors.locomotion.runtime.drives import gait_for
from ...collectors.locomotion.runtime.policy import GaitPolicy
from ...collectors.robots import POLICY_DECIMATION, TIMESTEP_S, RobotHandles, RobotSpec
from ...formats.core.errors import InputError
from ...formats.core.frames import quat_to_yaw

Array = NDArray[np.float64]

SPEED_M_S = 0.8
SETTLE_S, WARM_S = 1.0, 3.0
CYCLES = 2
MIN_RIM_M_S = 0.1  # standing wheels are watched for as long as they would turn twice at this
MOVES_M_S, TURNS_RAD_S = 0.05, 0.2


@dataclass(frozen=True)
class Stroll:
    """Record of two gait cycles, or of two turns of the wheels.

    Attributes:
        time_s: (T,) from 0 on, every physics step [s].
        position_m, quat_wxyz: (T, 3), (T, 4) of the base.
        joint_rad: (T, J).
        cycles: what a cycle is, in words.
        doing: what it did and how fast, in words.
    """

    time_s: Array
    position_m: Array
    quat_wxyz: Array
    joint_rad: Array
    cycles: str
    doing: str


def stroll(
    robot: RobotSpec,
    command: tuple[float, float, float] = (SPEED_M_S, 0.0, 0.0),
    policy: GaitPolicy | None = None,
) -> Stroll:
    """Walk along +x, turn or stand, and record two cycles once the gait is steady.

    Args:
        command: vx, vy [m/s] and yaw rate [rad/s], clipped to what the robot may be asked for.
        policy: what moves it; default what moves it in a replay.

    Raises:
        InputError: the robot has no joints to move with.
        FileFormatError: its policy's files are missing or broken.
    """
    if not robot.joints:
        raise InputError(f"{robot.name} has no joints: it is placed and cannot walk")
    gait = policy or gait_for(robot)
    wanted = robot.command_limits.clip(np.array(command))
    if robot.drive is not None:
        rim_m_s = max(float(np.abs(wanted).max()), MIN_RIM_M_S)
        period = 2 * math.pi * robot.drive.wheel_radius_m / rim_m_s
        cycles = "two turns of the wheels"
    elif isinstance(gait, GaitPolicy):
        period = 1.0 / gait.card.gait.frequency_hz
        walks = bool(gait.card.gait.moving(wanted[None])[0])
        cycles = f"two cycles of {period:.2f} s" if walks else f"{CYCLES * period:.2f} s"
    else:
        raise AssertionError("a robot with joints has wheels or a policy")
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
            moving = step * TIMESTEP_S >= SETTLE_S
            data.ctrl[handles.actuators] = gait.act(data, wanted if moving else np.zeros(3))
        rows[step] = data.qpos
        mujoco.mj_step(model, data)
    q, recorded = handles.root_qpos, rows[start:]
    position, quat = recorded[:, q : q + 3], recorded[:, q + 3 : q + 7]
    time_s = TIMESTEP_S * np.arange(len(recorded), dtype=np.float64)
    return Stroll(
        time_s=time_s,
        position_m=position - np.array([position[0, 0], 0.0, 0.0]),
        quat_wxyz=quat,
        joint_rad=recorded[:, handles.joint_qpos],
        cycles=cycles,
        doing=_in_words(robot, position[-1] - position[0], quat, time_s[-1]),
    )


def _in_words(robot: RobotSpec, moved: Array, quat_wxyz: Array, seconds: float) -> str:
    yaw = np.unwrap(quat_to_yaw(quat_wxyz))
    speed, turn = float(np.hypot(*moved[:2])) / seconds, float(yaw[-1] - yaw[0]) / seconds
    if abs(turn) > TURNS_RAD_S:
        return f"turning at {math.degrees(turn):.0f}°/s"
    if speed > MOVES_M_S:
        return f"{'driving' if robot.drive is not None else 'walking'} at {speed:.2f} m/s"
    return "standing"
