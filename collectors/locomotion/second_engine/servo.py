"""The servos' torque, computed outside MuJoCo."""

import numpy as np

from ....formats.core.arrays import Array
from ...robots import RobotSpec


class Servos:
    """PD servos of a robot with their motors' limits, as `shapes.add_servo` describes them."""

    def __init__(self, robot: RobotSpec) -> None:
        self._kp, self._kd, self._most, self._speed, share = (
            np.array([getattr(joint, key) for joint in robot.joints])
            for key in ("kp", "kd", "torque_nm", "speed_rad_s", "full_torque_speed")
        )
        self._stalled = self._most / (1.0 - share)

    def torque(self, target_rad: Array, joint_rad: Array, joint_rad_s: Array) -> Array:
        """Return torques (J,) [Nm] for joint targets (J,) at positions and velocities (J,)."""
        torque = self._kp * (target_rad - joint_rad) - self._kd * joint_rad_s
        # What the supply voltage leaves either way; beyond its no-load speed a motor brakes.
        lost = self._stalled * joint_rad_s / self._speed
        torque = np.clip(torque, -self._stalled - lost, self._stalled - lost)
        return np.clip(torque, -self._most, self._most)
