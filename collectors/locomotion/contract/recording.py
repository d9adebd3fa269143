"""A recorded walk: sensor values, commands and joint targets, to check another program with."""

from typing import Any

import mujoco
import numpy as np

from ...robots import POLICY_DECIMATION, RobotHandles, RobotSpec
from ..runtime.observation import states_of
from ..runtime.policy import GaitPolicy

# Of the robot's limits: vx, vy and yaw rate, each held for 2 s.
_SHARES = ((0, 0, 0), (0.5, 0, 0), (1, 0, 0.6), (0.3, 0.8, -0.8), (0, 0, 1), (-2, 0, 0), (0, 0, 0))
_HOLD_STEPS = 100


def recorded_walk(robot: RobotSpec, policy: GaitPolicy) -> dict[str, np.ndarray[Any, Any]]:
    """Walk on flat ground for 14 s and return what the gait saw and did, by name, (T, …) float64.

    The keys are `quat_wxyz`, `gyro_rad_s`, `velocity_base_m_s`, `joint_rad`, `joint_rad_s`,
    `command` (one of them beyond the limits) and `target_rad`, in the units of the card.
    """
    model = robot.build_model()
    data, handles = mujoco.MjData(model), RobotHandles.find(robot, model)
    handles.spawn(data)
    policy.reset()
    limits = robot.command_limits
    most = np.array([limits.vx_m_s[1], limits.vy_m_s[1], limits.yaw_rad_s[1]])
    rows: dict[str, list[Any]] = {}
    for share in _SHARES:
        command = most * share
        for _ in range(_HOLD_STEPS):
            state = states_of(data.qpos[None], data.qvel[None], handles)
            q = handles.root_qpos
            row = {
                "quat_wxyz": data.qpos[q + 3 : q + 7].copy(),
                "gyro_rad_s": state.angular_velocity_rad_s[0],
                "velocity_base_m_s": state.linear_velocity_m_s[0],
                "joint_rad": data.qpos[handles.joint_qpos],
                "joint_rad_s": data.qvel[handles.joint_dof],
                "command": command,
                "target_rad": policy.act(data, command).copy(),
            }
            for key, value in row.items():
                rows.setdefault(key, []).append(value)
            data.ctrl[handles.actuators] = row["target_rad"]
            mujoco.mj_step(model, data, nstep=POLICY_DECIMATION)
    return {key: np.array(values) for key, values in rows.items()}
