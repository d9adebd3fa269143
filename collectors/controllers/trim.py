"""Learn from poses what a robot's velocity lacks of its command, and add it to the command.

A gait that errs in its own velocity, one on a slope, or one on a soft floor walks slower, faster or
more to one side than asked. This error lasts, so that its integral absorbs it.
"""

import math

from .geometry import clip, wrap_angle
from .interface import Command, Pose


class VelocityTrim:
    """An integral of the velocity error in the base frame, for one episode."""

    def __init__(self, lag_s: float, rate_hz: int, *, time_s: float, most_m_s: float) -> None:
        """Begin with no correction.

        Args:
            lag_s: by how much the robot's velocity lags behind its command.
            rate_hz: rate of `corrected`.
            time_s: the integral's time constant.
            most_m_s: greatest correction along either axis; 0 corrects nothing.
        """
        self._share = 1.0 / max(1.0, lag_s * rate_hz)
        self._rate_hz, self._time_s, self._most_m_s = rate_hz, time_s, most_m_s
        self._pose: Pose | None = None
        self._command, self._expected, self._trim = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)

    def corrected(self, pose: Pose, command: Command) -> Command:
        """Return the command that makes the robot move as `command` says, from now on."""
        before = self._pose or pose
        heading = before.yaw_rad + 0.5 * wrap_angle(pose.yaw_rad - before.yaw_rad)
        cos, sin = math.cos(heading), math.sin(heading)
        dx, dy = pose.x_m - before.x_m, pose.y_m - before.y_m
        moved = self._rate_hz * (cos * dx + sin * dy), self._rate_hz * (cos * dy - sin * dx)
        pairs = zip(self._expected, self._command, strict=True)
        self._expected = tuple(old + self._share * (new - old) for old, new in pairs)
        gain, most = 1.0 / (self._time_s * self._rate_hz), self._most_m_s
        self._trim = tuple(
            clip(trim + gain * (expected - speed), -most, most)
            for trim, expected, speed in zip(self._trim, self._expected, moved, strict=True)
        )
        self._pose, self._command = pose, command[:2]
        return command[0] + self._trim[0], command[1] + self._trim[1], command[2]

    def carried(self, pose: Pose, seconds: float) -> tuple[float, float]:
        """Return x, y [m] to where the error alone, no longer corrected, takes the robot."""
        ahead, left = (-seconds * trim for trim in self._trim)
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        return pose.x_m + cos * ahead - sin * left, pose.y_m + sin * ahead + cos * left
