"""Continuous motions of a policy: velocities, or waypoints that the robot moves to one by one.

Waypoints are pursued with VLN-PE's proportional gains. Nothing here knows the map: a waypoint
behind a wall leads into the wall.
"""

import math
from dataclasses import dataclass
from typing import Protocol

from .geometry import clip, clip_command, ramped, wrap_angle
from .interface import STOPPED, Command, Decision, Pose, Task


@dataclass(frozen=True)
class Velocity:
    """A velocity in the base frame, held for one action of 50 physics steps.

    Attributes:
        command: vx, vy [m/s], yaw rate [rad/s]; clipped to the robot's limits.
    """

    command: Command


@dataclass(frozen=True)
class Waypoints:
    """Displacements, each in the frame of the pose before it.

    Attributes:
        steps: (Δx, Δy [m], Δyaw [rad]), x ahead and y to the left.
    """

    steps: tuple[Command, ...]


Motion = Velocity | Waypoints


class Steerer(Protocol):
    """Chooses continuous motions one after another; one object serves one episode."""

    def next_motion(self, pose: Pose) -> Motion | None:
        """Return what to do from `pose` on; None stops the robot for good."""
        ...

    def notes(self) -> list[tuple[str, str]]:
        """Return (kind, detail) of what happened since the last call."""
        ...


@dataclass(frozen=True)
class SteeredConfig:
    """Parameters of the execution of motions.

    Attributes:
        action_s: how long a velocity is held.
        linear_gain, angular_gain: VLN-PE's proportional gains [1/s].
        cruise_m_s, turn_rad_s: greatest speeds towards a waypoint.
        reached_m, reached_rad: a waypoint is reached within these.
        turn_on_spot_rad: larger errors of direction are corrected by turning before driving.
        near_m: a waypoint nearer than this is reached sideways or not at all, without turning.
        ramp_m_s2, ramp_rad_s2: how fast commands change.
        slow_m_s, slow_rad_s, spare_s: a waypoint that takes longer than its length and turn at
            these speeds, and the spare time, is given up for the next one.
    """

    action_s: float = 0.25
    linear_gain: float = 1.5
    angular_gain: float = 2.5
    cruise_m_s: float = 0.8
    turn_rad_s: float = 1.0
    reached_m: float = 0.1
    reached_rad: float = math.radians(6.0)
    turn_on_spot_rad: float = math.radians(40.0)
    near_m: float = 0.15
    ramp_m_s2: float = 3.0
    ramp_rad_s2: float = 4.0
    slow_m_s: float = 0.25
    slow_rad_s: float = 0.3
    spare_s: float = 1.0


class SteeredController:
    """See the module; satisfies `Controller`."""

    rate_hz = 100  # an action ends where a frame of a dataset does, after 0.25 s

    def __init__(self, task: Task, steerer: Steerer, config: SteeredConfig | None = None) -> None:
        self._task, self._steerer = task, steerer
        self._config = config or SteeredConfig()
        self._command: Command = STOPPED
        self._velocity: Command | None = None
        self._ahead: list[tuple[Pose, float]] = []  # targets, and how long each may take [s]
        self._until_s = 0.0

    @property
    def nominal_s(self) -> float:
        """Time of the straight way to the goal at cruising speed."""
        (x0, y0), (x1, y1) = self._task.reference_xy_m[0], self._task.goal_xy_m
        return math.hypot(x1 - x0, y1 - y0) / self._config.cruise_m_s

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        while self._ahead and (time_s >= self._until_s - 1e-9 or self._reached(pose)):
            self._next(time_s)
        notes: tuple[tuple[str, str], ...] = ()
        chosen = not self._ahead and (self._velocity is None or time_s >= self._until_s - 1e-9)
        if chosen:
            motion = self._steerer.next_motion(pose)
            notes = tuple(self._steerer.notes())
            if motion is None:
                return Decision(STOPPED, done=True, notes=notes, chosen=True)
            notes = (*notes, self._begin(motion, time_s, pose))
        target = self._towards(self._ahead[0][0], pose) if self._ahead else self._velocity
        config = self._config
        linear, turn = config.ramp_m_s2 / self.rate_hz, config.ramp_rad_s2 / self.rate_hz
        self._command = ramped(self._command, target or STOPPED, linear, turn)
        return Decision(self._command, chosen=chosen, notes=notes)

    def _begin(self, motion: Motion, time_s: float, pose: Pose) -> tuple[str, str]:
        """Start a motion; return its description for the record."""
        config, limits = self._config, self._task.limits
        if isinstance(motion, Velocity):
            self._velocity = clip_command(motion.command, limits)
            self._until_s = time_s + config.action_s
            return "velocity", " ".join(f"{value:.3f}" for value in motion.command)
        self._velocity = None
        for dx, dy, turn in motion.steps:
            cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
            x, y = pose.x_m + cos * dx - sin * dy, pose.y_m + sin * dx + cos * dy
            pose = Pose(x, y, wrap_angle(pose.yaw_rad + turn))
            # The way there may need a turn of its own before and after.
            turning = abs(turn) + 2.0 * abs(math.atan2(dy, dx)) * (math.hypot(dx, dy) > 0)
            spare = config.spare_s + turning / config.slow_rad_s
            self._ahead.append((pose, math.hypot(dx, dy) / config.slow_m_s + spare))
        self._until_s = time_s + self._ahead[0][1]
        return "waypoints", "; ".join(" ".join(f"{v:.3f}" for v in s) for s in motion.steps)

    def _next(self, time_s: float) -> None:
        self._ahead.pop(0)
        if self._ahead:
            self._until_s = time_s + self._ahead[0][1]

    def _reached(self, pose: Pose) -> bool:
        target = self._ahead[0][0]
        near = math.hypot(target.x_m - pose.x_m, target.y_m - pose.y_m) < self._config.reached_m
        # Only the last one's heading matters: the others are passed.
        turned = abs(wrap_angle(target.yaw_rad - pose.yaw_rad)) < self._config.reached_rad
        return near and (turned or len(self._ahead) > 1)

    def _towards(self, target: Pose, pose: Pose) -> Command:
        config, limits = self._config, self._task.limits
        dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
        distance = math.hypot(dx, dy)
        if distance < config.reached_m:
            return 0.0, 0.0, self._turn(wrap_angle(target.yaw_rad - pose.yaw_rad))
        error = wrap_angle(math.atan2(dy, dx) - pose.yaw_rad)
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        ahead, left = cos * dx + sin * dy, -sin * dx + cos * dy
        if distance < config.near_m:  # overshot, or beside it: not worth a turn
            vx, vy = config.linear_gain * ahead, config.linear_gain * left
            turn = self._turn(wrap_angle(target.yaw_rad - pose.yaw_rad))
            return clip_command((vx, vy, turn), limits)
        if abs(error) > config.turn_on_spot_rad:
            return 0.0, 0.0, self._turn(error)
        speed = min(config.linear_gain * distance, config.cruise_m_s)
        if len(self._ahead) > 1:  # passed, not stopped at
            speed = config.cruise_m_s
        return clip(speed * math.cos(error) ** 2, *limits.vx_m_s), 0.0, self._turn(error)

    def _turn(self, error: float) -> float:
        fastest = self._config.turn_rad_s
        rate = clip(self._config.angular_gain * error, -fastest, fastest)
        return clip(rate, *self._task.limits.yaw_rad_s)
