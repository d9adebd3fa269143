"""Records the state of the physics along a rollout, 100 samples a second."""

from typing import Any

import numpy as np

from ...formats.core.frames import quat_to_matrix
from ...formats.core.rollout import STATE_RATE_HZ
from ..robots import TIMESTEP_S
from .world import World

STEPS_PER_SAMPLE = round(1.0 / (STATE_RATE_HZ * TIMESTEP_S))
TOUCH_N = 1.0  # a foot that carries less is in the air


class Recorder:
    """Raw physics state by sample; `arrays` converts it into the fields of a Rollout.

    Joint torques, foot contacts and the IMU of a sample are those of the physics step that led to
    it, so they are 5 ms older than its state.
    """

    def __init__(self, world: World, capacity: int = 2048) -> None:
        self._world, self._count = world, 0
        data = world.data
        self._sources = (data.qpos, data.qvel, data.actuator_force, data.sensordata)
        self._rows = [np.empty((capacity, len(source))) for source in self._sources]
        self._command = np.empty((capacity, 3))

    def __len__(self) -> int:
        return self._count

    def sample(self, command: tuple[float, float, float]) -> None:
        """Record the state now, and the command that begins now."""
        k = self._count
        if k == len(self._command):
            self._grow()
        for rows, source in zip(self._rows, self._sources, strict=True):
            rows[k] = source
        self._command[k] = command
        self._count = k + 1

    def repeat(self, samples: int) -> None:
        """Record the last sample again, so many times more."""
        while self._count + samples > len(self._command):
            self._grow()
        k = self._count
        for rows in (*self._rows, self._command):
            rows[k : k + samples] = rows[k - 1]
        self._count = k + samples

    def drop_after(self, samples: int) -> None:
        """Keep the first samples only."""
        self._count = min(self._count, samples)

    def drop_broken(self) -> None:
        """Forget the first sample with a number that is not finite, and all after it."""
        bad = np.zeros(self._count, dtype=bool)
        for rows in self._rows:
            bad |= ~np.isfinite(rows[: self._count]).all(axis=1)
        if bad.any():
            self._count = int(np.argmax(bad))

    def arrays(self) -> dict[str, Any]:
        """Return the Rollout's array fields by name."""
        n, handles = self._count, self._world.handles
        qpos, qvel, force, sensors = (rows[:n] for rows in self._rows)
        q, v = handles.root_qpos, handles.root_dof
        position, quat = qpos[:, q : q + 3], qpos[:, q + 3 : q + 7]
        to_base = quat_to_matrix(quat).swapaxes(-1, -2)
        imu = [sensors[:, at : at + 3] for at in (handles.accelerometer, handles.gyro)]
        return {
            "time_s": np.arange(n) / STATE_RATE_HZ,
            "position_world_m": position.copy(),
            "quat_wxyz": quat.copy(),
            # MuJoCo's free joint: linear velocity in the world, angular velocity in the base.
            "linear_velocity_base_m_s": np.einsum("tij,tj->ti", to_base, qvel[:, v : v + 3]),
            "angular_velocity_base_rad_s": qvel[:, v + 3 : v + 6].copy(),
            "joint_position_rad": qpos[:, handles.joint_qpos],
            "joint_velocity_rad_s": qvel[:, handles.joint_dof],
            "joint_torque_nm": force[:, handles.actuators],
            "command": self._command[:n].copy(),
            "foot_contact": sensors[:, handles.foot_touch] > TOUCH_N,
            "foot_force_n": sensors[:, handles.foot_touch],
            "imu": np.concatenate(imu, axis=1),
            "floor_z_m": self._world.surface.height_at(
                position[:, :2], position[:, 2] - self._world.robot.base_height_m
            ),
        }

    def _grow(self) -> None:
        self._rows = [np.concatenate([rows, np.empty_like(rows)]) for rows in self._rows]
        self._command = np.concatenate([self._command, np.empty_like(self._command)])
