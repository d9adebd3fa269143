"""Actuation of a robot: wheels, a trained gait, or none."""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.arrays import Array
from ...robots import POLICY_DECIMATION, TIMESTEP_S, RobotSpec
from .policy import GaitPolicy

_STEP_S = POLICY_DECIMATION * TIMESTEP_S


class DifferentialDrive:
    """Ramped wheel speeds of a differential drive; satisfies `world.Gait`.

    A wheel on the side y turns with (vx − y · yaw rate) / radius. Joints that are no wheels are
    held in their default position.
    """

    def __init__(self, robot: RobotSpec) -> None:
        """Drive `robot`, which must have a `drive`.

        Raises:
            ValueError: the robot has no `drive`.
        """
        drive = robot.drive
        if drive is None:
            raise ValueError(f"{robot.name} has no wheels to drive")
        self.robot = robot
        side = np.zeros(len(robot.joints))
        for names, sign in ((drive.left, 1.0), (drive.right, -1.0)):
            side[[robot.joint_names.index(name) for name in names]] = sign
        self._wheels = np.flatnonzero(side)
        self._y_m = 0.5 * drive.track_m * side[self._wheels]
        self._default, self._speed = robot.default_joint_rad, np.zeros(2)
        self._radius_m = drive.wheel_radius_m
        self._most = _STEP_S * np.array([drive.ramp_m_s2, drive.ramp_rad_s2])

    @property
    def memory(self) -> tuple[NDArray[Any], ...]:
        """The commanded speed."""
        return (self._speed,)

    def reset(self, seed: int | None = None) -> None:
        """Forget the speed; call at the start of every rollout. Wheels need no state."""
        self._speed[:] = 0.0

    def act(self, data: mujoco.MjData, command: ArrayLike) -> Array:
        """Return servo targets for the next 20 ms: wheel speeds [rad/s], joint positions [rad].

        Args:
            data: unused; the wheels' servos close the loop.
            command: (3,) vx, vy [m/s] and yaw rate [rad/s], clipped to the robot's limits; vy is
                not possible and ignored.

        Returns:
            (J,) in the order of `robot.joint_names`.
        """
        target = self.robot.command_limits.clip(np.asarray(command, dtype=np.float64))[[0, 2]]
        self._speed += np.clip(target - self._speed, -self._most, self._most)
        targets = self._default.copy()
        targets[self._wheels] = (self._speed[0] - self._y_m * self._speed[1]) / self._radius_m
        return targets


class Still:
    """No actuation, for an agent without joints, which can only be placed."""

    memory = ()

    def reset(self, seed: int | None = None) -> None:
        """Do nothing."""

    def act(self, data: mujoco.MjData, command: ArrayLike) -> Array:
        """Return no targets, (0,)."""
        return np.empty(0)


def gait_for(robot: RobotSpec) -> DifferentialDrive | GaitPolicy | Still:
    """Return the actuation of `robot`: its wheels, its trained policy, or none.

    Raises:
        FileFormatError: the policy's files are missing or broken.
        PolicyMismatchError: the policy was trained on another model or layout.
    """
    if robot.drive is not None:
        return DifferentialDrive(robot)
    return GaitPolicy.load(robot) if robot.joints else Still()
