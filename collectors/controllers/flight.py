"""A staircase as a controller takes it: straight runs along its middle, with turns on landings.

A robot lines up with a run before it goes along it, keeps to its middle and its direction, and
turns nowhere else.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.rollout import FORWARD_STEP_M, TURN_STEP_RAD, Action
from .geometry import clip, clip_command, wrap_angle
from .interface import STOPPED, Decision, Pose, Task

PACE_M_S = 0.4  # on stairs and near to them; see `World.paced`
STRAIGHT_RAD = math.radians(10.0)  # runs whose directions differ by less are one


@dataclass(frozen=True)
class FlightConfig:
    """Parameters of taking stairs.

    Attributes:
        cruise_m_s: commanded speed.
        aim_m: distance along the run to the point aimed at.
        lined_up_m, lined_up_rad: a robot that is nearer to the middle and to the direction of a run
            goes along it.
        reached_m: a run ends so far before its end.
        heading_gain, lateral_gain: proportional gains [1/s].
        lateral_m_s, turn_rad_s: greatest corrections to the side and of the heading.
    """

    cruise_m_s: float = PACE_M_S
    aim_m: float = 0.6
    lined_up_m: float = 0.1
    lined_up_rad: float = math.radians(10.0)
    reached_m: float = 0.08
    heading_gain: float = 2.5
    lateral_gain: float = 2.0
    lateral_m_s: float = 0.15
    turn_rad_s: float = 0.8


# Whole steps end runs to the nearest one, and whole turns must not be answered by opposite ones.
DISCRETE = FlightConfig(aim_m=1.2, reached_m=0.5 * FORWARD_STEP_M)


class FlightLine:
    """Progress along the straight runs of a staircase.

    Attributes:
        done: whether the last run's end is reached.
        lined_up: whether the robot is to go along the present run.
        error_rad: how far left of its heading the point is that the robot aims at.
        left_m: how far left of the robot the run's line is.
        length_m, turning_rad: of all runs, and of the corners between them.
    """

    def __init__(self, xy_m: Array, config: FlightConfig) -> None:
        """Divide a path (P, 2) [m] where it turns."""
        self._config = config
        steps = np.diff(xy_m, axis=0)
        steps = steps[np.linalg.norm(steps, axis=1) > 1e-6]
        heading = np.arctan2(steps[:, 1], steps[:, 0])
        turns = np.abs([wrap_angle(turn) for turn in np.diff(heading).tolist()])
        parts = np.split(steps, np.flatnonzero(turns > STRAIGHT_RAD) + 1)
        self._runs, start = [], xy_m[0]
        for part in parts:
            end = start + part.sum(axis=0)
            self._runs.append((start, end))
            start = end
        self.length_m = float(np.linalg.norm(steps, axis=1).sum())
        self.turning_rad = float(turns[turns > STRAIGHT_RAD].sum())
        self._at = 0
        self.done = self.lined_up = False
        self.error_rad = self.left_m = 0.0

    def look(self, pose: Pose) -> None:
        """Take note of where the robot is."""
        config = self._config
        while True:
            (x, y), (x1, y1) = (point.tolist() for point in self._runs[self._at])
            length = math.hypot(x1 - x, y1 - y)
            cos, sin = (x1 - x) / length, (y1 - y) / length
            dx, dy = pose.x_m - x, pose.y_m - y
            along = cos * dx + sin * dy
            if length - along > config.reached_m:
                break
            if self._at == len(self._runs) - 1:
                self.done = True
                break
            self._at, self.lined_up = self._at + 1, False
        self.left_m = sin * dx - cos * dy
        bearing = math.atan2(sin, cos) + math.atan2(self.left_m, config.aim_m)
        self.error_rad = wrap_angle(bearing - pose.yaw_rad)
        straight = abs(self.error_rad) < config.lined_up_rad
        self.lined_up |= straight and abs(self.left_m) < config.lined_up_m


class FlightController:
    """Follows stairs continuously, as the controller `path` does; satisfies `Controller`."""

    rate_hz = 25

    def __init__(self, task: Task, config: FlightConfig = FlightConfig()) -> None:
        self._limits, self._config = task.limits, config
        self._line = FlightLine(task.reference_xy_m, config)

    @property
    def nominal_s(self) -> float:
        """Time of all runs and turns."""
        line, config = self._line, self._config
        return line.length_m / config.cruise_m_s + line.turning_rad / config.turn_rad_s

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`."""
        line, config = self._line, self._config
        line.look(pose)
        if line.done:
            return Decision(STOPPED, done=True)
        # Seen from the robot, the line's side is left or right by its heading as good as along it.
        side = clip(config.lateral_gain * line.left_m, -config.lateral_m_s, config.lateral_m_s)
        turn = clip(config.heading_gain * line.error_rad, -config.turn_rad_s, config.turn_rad_s)
        ahead = config.cruise_m_s * max(0.0, math.cos(line.error_rad)) ** 2
        if not line.lined_up:
            ahead = 0.0
            side *= max(0.0, math.cos(line.error_rad))
        return Decision(clip_command((ahead, side, turn), self._limits))


class FlightExpert:
    """The expert on stairs: discrete actions along their runs; satisfies `Chooser`.

    Attributes:
        length_m, stairs_m, turning_rad: see `Expert`.
    """

    length_m = 0.0

    def __init__(self, task: Task, config: FlightConfig = DISCRETE) -> None:
        self._line = FlightLine(task.reference_xy_m, config)
        self.stairs_m, self.turning_rad = self._line.length_m, self._line.turning_rad
        self._last = Action.FORWARD

    def notes(self) -> list[tuple[str, str]]:
        """Return nothing: there is no other way to plan."""
        return []

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """Return the action to take from `pose`; STOP at the end of the last run.

        See `Expert.next_action`.
        """
        self._line.look(pose)
        if self._line.done:
            return Action.STOP
        self._last = step_along(self._line, self._last)
        return self._last


def step_along(line: FlightLine, last: Action) -> Action:
    """Return the discrete action along a line from where it was looked at last.

    Args:
        last: the action before; a turn is not answered by the opposite one.
    """
    error = line.error_rad
    least = (0.75 if line.lined_up else 0.5) * TURN_STEP_RAD
    left = TURN_STEP_RAD if last is Action.RIGHT else least
    right = TURN_STEP_RAD if last is Action.LEFT else least
    return Action.LEFT if error > left else Action.RIGHT if error < -right else Action.FORWARD
