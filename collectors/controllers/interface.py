"""Interfaces of controllers: task, poses in, decisions out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.rollout import Action
from ...formats.scene.freemap import Freemap
from ..robots import CommandLimits


@dataclass(frozen=True)
class Coasting:
    """Coasting of a robot: what it still travels and turns after its command has dropped to zero.

    Attributes:
        speed_m_s: (K,) ascending, greater than 0.
        distance_m: (K,) from the zero command to rest, after walking steadily.
        lag_s: by how much walking lags behind its command: what was commanded in this time is
            still to come.
        turn_lag_s: by how much a turn lags behind its command: the angle that is turned on after
            the zero command, over the turn rate before it.
    """

    speed_m_s: tuple[float, ...] = ()
    distance_m: tuple[float, ...] = ()
    lag_s: float = 0.0
    turn_lag_s: float = 0.0

    def distance(self, speed_m_s: float) -> float:
        """Return the stopping distance [m], interpolated linearly and constant beyond the last."""
        table = (0.0, *self.speed_m_s), (0.0, *self.distance_m)
        return float(np.interp(speed_m_s, *table))


# vx, vy [m/s] and yaw rate [rad/s] in the base frame.
Command = tuple[float, float, float]
STOPPED: Command = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pose:
    """Pose of the base: world [m], heading [rad]."""

    x_m: float
    y_m: float
    yaw_rad: float


class Chooser(Protocol):
    """Chooses discrete actions one after another; one object serves one episode."""

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """Return the action to take.

        Args:
            pose: where the robot will be when the action begins, as far as the controller knows.
            rest: where it would come to rest if it stopped now; `pose` when None.
        """
        ...

    def notes(self) -> list[tuple[str, str]]:
        """Return (kind, detail) of what happened since the last call."""
        ...


@dataclass(frozen=True)
class Task:
    """Task of a controller.

    Attributes:
        reference_xy_m: (P, 2) the episode's reference path, world [m].
        goal_xy_m: (2,) where to stop [m].
        freemap: where the robot may be.
        radius_m: disc around the base that must stay free [m].
        limits: commands the robot understands.
        goal_tolerance_m: a stop within this distance of the goal is a success [m].
        coasting: of the robot, for controllers that stop it while it is moving.
        chooser: chooses the discrete actions; the expert when None.
        legs: of a path over storeys: tasks on one level or one staircase each, one after another.
            None of them has legs.
        is_stairs: the path leads along the middle of a staircase.
        passes_on: another leg follows: the robot does not slow down for the goal.
    """

    reference_xy_m: Array
    goal_xy_m: Array
    freemap: Freemap
    radius_m: float
    limits: CommandLimits
    goal_tolerance_m: float
    coasting: Coasting = Coasting()
    chooser: Chooser | None = None
    legs: "tuple[Task, ...]" = ()
    is_stairs: bool = False
    passes_on: bool = False


@dataclass(frozen=True)
class Decision:
    """Output of a control step, valid until the next one.

    Attributes:
        command: within the robot's limits.
        action: the discrete action that starts with this step; None while one goes on, and for
            controllers that know none.
        done: the controller has stopped the robot for good.
        notes: (kind, detail) of events worth recording, e.g. a re-plan.
        chosen: a motion that a policy chose starts with this step.
    """

    command: Command
    action: Action | None = None
    done: bool = False
    notes: tuple[tuple[str, str], ...] = ()
    chosen: bool = False


@dataclass(frozen=True)
class Jump:
    """A discrete action executed at once, without physics.

    Attributes:
        pose: pose afterwards.
    """

    action: Action
    pose: Pose


class Teleporter(Protocol):
    """Controller of robots that are placed at one pose after another."""

    def jump(self, pose: Pose) -> Jump:
        """Return the pose that follows `pose`; STOP with the same pose at the end."""
        ...


class Controller(Protocol):
    """Converts true poses to velocity commands; one object serves one episode."""

    @property
    def rate_hz(self) -> int:
        """Rate at which `step` is to be called: a divisor of the record's 100 Hz."""
        ...

    @property
    def nominal_s(self) -> float:
        """Duration of an undisturbed execution [s]."""
        ...

    def step(self, time_s: float, pose: Pose) -> Decision:
        """Return the decision at `time_s`, counted from the start of the episode.

        Called at `rate_hz` until a decision is done.
        """
        ...
