"""Closed loop: hold a discrete action to its 0.25 m or 15°, momentum and drift included.

The action has a track: 0.25 m straight ahead from where it began, or a turn on that very spot. The
robot is steered along it, kept to it sideways and in heading, and slowed down in time when
something else comes next, so that it neither coasts into a turn nor swings into a step.
"""

import math
from dataclasses import dataclass

from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from ..robots import CommandLimits
from .geometry import clip, clip_command, wrap_angle
from .interface import STOPPED, Command, Pose


@dataclass(frozen=True)
class ServoConfig:
    """Gains and limits of the closed loop.

    Attributes:
        cruise_m_s, turn_rad_s: speed of steps and turns.
        reaction_s: how long a body takes to answer a command; it brakes this much earlier.
        brake_m_s2, brake_rad_s2: how hard it slows down before something else comes.
        slow_m_s, slow_rad_s: how fast it may still be then.
        heading_gain, sideways_gain: correction of a step's heading and of its line [1/s].
        hold_gain, hold_m_s: correction of a turn's place [1/s], and the fastest of it [m/s].
        longest_s: an action that has not arrived by then is over, wherever the robot is.
    """

    cruise_m_s: float = 0.6
    turn_rad_s: float = math.radians(60.0)
    reaction_s: float = 0.2
    brake_m_s2: float = 0.7
    brake_rad_s2: float = 3.0
    slow_m_s: float = 0.1
    slow_rad_s: float = 0.6
    heading_gain: float = 4.0
    sideways_gain: float = 3.0
    hold_gain: float = 4.0
    hold_m_s: float = 0.3
    longest_s: float = 1.5


@dataclass(frozen=True)
class Track:
    """Target displacement of an action that begins at `start`."""

    action: Action
    start: Pose

    @property
    def end(self) -> Pose:
        """Pose after an exact execution."""
        x, y, yaw = self.start.x_m, self.start.y_m, self.start.yaw_rad
        if self.action is Action.FORWARD:
            return Pose(x + FORWARD_STEP_M * math.cos(yaw), y + FORWARD_STEP_M * math.sin(yaw), yaw)
        return Pose(x, y, wrap_angle(yaw + self.sense * TURN_STEP_RAD))

    @property
    def sense(self) -> float:
        """1 to the left, −1 to the right, 0 for actions that do not turn."""
        return {Action.LEFT: 1.0, Action.RIGHT: -1.0}.get(self.action, 0.0)

    def local(self, pose: Pose) -> tuple[float, float, float]:
        """Return the displacement since the start: ahead, left [m], turned left [rad]."""
        dx, dy = pose.x_m - self.start.x_m, pose.y_m - self.start.y_m
        cosine, sine = math.cos(self.start.yaw_rad), math.sin(self.start.yaw_rad)
        turned = wrap_angle(pose.yaw_rad - self.start.yaw_rad)
        return cosine * dx + sine * dy, cosine * dy - sine * dx, turned

    def remaining(self, pose: Pose) -> float:
        """Return what remains, [m] of a step or [rad] of a turn; negative beyond the end."""
        ahead, _, turned = self.local(pose)
        if self.action is Action.FORWARD:
            return FORWARD_STEP_M - ahead
        return TURN_STEP_RAD - self.sense * turned


def braking(track: Track, pose: Pose, soon: Pose, config: ServoConfig) -> float | None:
    """Return the speed [m/s] or turn rate [rad/s] allowed if the robot must be slow at the end.

    Args:
        pose: where the robot is.
        soon: where it will be after its reaction time, at the speed it has. Only steps need it: a
            body that swings on after a turn is straightened by the next step.

    Returns:
        None while that is no less than cruising, and for STOP.
    """
    left = track.remaining(pose)
    if track.action is Action.FORWARD:
        left = min(left, track.remaining(soon))
        slow, brake, cruise = config.slow_m_s, config.brake_m_s2, config.cruise_m_s
    elif track.sense:
        slow, brake, cruise = config.slow_rad_s, config.brake_rad_s2, config.turn_rad_s
    else:
        return None
    if left < 0.0:  # coasting would lead too far
        return max(slow + config.hold_gain * left, -config.hold_m_s)
    speed = math.sqrt(slow * slow + 2 * brake * left)
    return speed if speed < cruise else None


def steer(
    track: Track, pose: Pose, speed: float, config: ServoConfig, limits: CommandLimits
) -> Command:
    """Return the command that follows a track at a speed [m/s], or turn rate [rad/s]."""
    ahead, left, turned = track.local(pose)
    if track.action is Action.STOP:
        return STOPPED
    if track.action is Action.FORWARD:
        command = (speed, -config.sideways_gain * left, -config.heading_gain * turned)
    else:
        # Back to the spot, as seen from the body that has turned meanwhile.
        back, aside = -config.hold_gain * ahead, -config.hold_gain * left
        cosine, sine = math.cos(turned), math.sin(turned)
        most = config.hold_m_s
        command = (
            clip(cosine * back + sine * aside, -most, most),
            clip(cosine * aside - sine * back, -most, most),
            track.sense * speed,
        )
    return clip_command(command, limits)
