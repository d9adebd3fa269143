"""What a person at the controls asks for, and the controllers that carry it out."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ...formats.core.rollout import REST_M_S, Action
from ..controllers import STOPPED, Decision, Pose, SpeedConfig, Task
from ..controllers.geometry import clip_command, ramped
from ..controllers.interface import Command
from ..controllers.speed import SpeedController

SILENCE_S = 0.3  # without a word from the person for so long, nothing is held any more


class WaitingError(Exception):
    """The person asks for nothing and the robot rests: time stands still."""


@dataclass(frozen=True)
class Speeds:
    """Speeds at full deflection; commands stay within the robot's limits.

    Attributes:
        ramp_m_s2, ramp_rad_s2: how fast commands change.
        rest_s: the robot rests once it has been slower than 0.05 m/s for so long.
        rest_most_s: it is taken to rest at the latest so long after the command came to nothing.
    """

    ahead_m_s: float = 0.8
    left_m_s: float = 0.3
    turn_rad_s: float = 1.0
    ramp_m_s2: float = 3.0
    ramp_rad_s2: float = 4.0
    rest_s: float = 0.25
    rest_most_s: float = 2.0


class Controls:
    """What a person holds now, written by one thread and read by another.

    Attributes:
        recorded: decisions of the journal by tick, which come before anything that is held.
    """

    def __init__(
        self,
        recorded: Mapping[int, Decision] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.recorded = dict(recorded or {})
        self._clock, self._lock = clock, threading.Lock()
        self._axes, self._heard_s = (0.0, 0.0, 0.0), -math.inf
        self._tapped: Action | None = None
        self._stop = False

    def hold(self, ahead: float, left: float, turn: float) -> None:
        """Hold the sticks so from now on, each from -1 to 1; to be repeated within `SILENCE_S`."""
        values = (ahead, left, turn)
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"sticks at {values}; valid: numbers from -1 to 1")
        with self._lock:
            before, self._heard_s = self._held(), self._clock()
            x, y, z = (min(max(value, -1.0), 1.0) for value in values)
            self._axes = (x, y, z)
            action = _action(self._axes)
            if action is not None and action is not _action(before):
                self._tapped = action

    def stop(self) -> None:
        """End the episode here."""
        with self._lock:
            self._stop = True

    def release(self) -> None:
        """Forget everything that was asked for."""
        with self._lock:
            self._axes, self._tapped, self._stop = (0.0, 0.0, 0.0), None, False

    def axes(self) -> tuple[float, float, float]:
        """Return ahead, left, turn, each from -1 to 1; zeros if the person has fallen silent."""
        with self._lock:
            return self._held()

    def take_stop(self) -> bool:
        """Return, once, whether the episode shall end."""
        with self._lock:
            stop, self._stop = self._stop, False
            return stop

    def take_action(self) -> Action | None:
        """Return the action that was tapped, each once, or the one that is held."""
        with self._lock:
            tapped, self._tapped = self._tapped, None
            return tapped or _action(self._held())

    def _held(self) -> tuple[float, float, float]:
        silent = self._clock() - self._heard_s > SILENCE_S
        return (0.0, 0.0, 0.0) if silent else self._axes


def _action(axes: tuple[float, float, float]) -> Action | None:
    ahead, _, turn = axes
    if abs(turn) > 0.5:
        return Action.LEFT if turn > 0 else Action.RIGHT
    return Action.FORWARD if ahead > 0.5 else None


class VelocityControl:
    """Velocities as a person asks for them; satisfies `Controller`."""

    rate_hz = 50

    def __init__(self, task: Task, source: Controls, speeds: Speeds | None = None) -> None:
        self.source, self._speeds = source, speeds or Speeds()
        self._limits, self._command = task.limits, STOPPED
        (x0, y0), (x1, y1) = task.reference_xy_m[0], task.goal_xy_m
        self.nominal_s = math.hypot(x1 - x0, y1 - y0) / self._speeds.ahead_m_s
        self._since_zero: deque[Pose] = deque(maxlen=round(self._speeds.rest_s * self.rate_hz) + 1)
        self._zero_steps = round(self._speeds.rest_most_s * self.rate_hz)  # it begins at rest

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`.

        Raises:
            WaitingError: the person asks for nothing, and the robot rests.
        """
        decision = self.source.recorded.get(round(100 * time_s))
        if decision is None:
            decision = self._live(pose)
        self._command = decision.command
        if self._command == STOPPED:
            self._since_zero.append(pose)
            self._zero_steps += 1
        else:
            self._since_zero.clear()
            self._zero_steps = 0
        return decision

    def _live(self, pose: Pose) -> Decision:
        if self.source.take_stop():
            return Decision(STOPPED, done=True)
        speeds, (ahead, left, turn) = self._speeds, self.source.axes()
        target: Command = (
            ahead * speeds.ahead_m_s,
            left * speeds.left_m_s,
            turn * speeds.turn_rad_s,
        )
        if target == self._command == STOPPED and self._rests(pose):
            raise WaitingError
        linear, spin = speeds.ramp_m_s2 / self.rate_hz, speeds.ramp_rad_s2 / self.rate_hz
        return Decision(ramped(self._command, clip_command(target, self._limits), linear, spin))

    def _rests(self, pose: Pose) -> bool:
        speeds, past = self._speeds, self._since_zero
        if self._zero_steps >= speeds.rest_most_s * self.rate_hz:
            return True
        moved_m = math.hypot(pose.x_m - past[0].x_m, pose.y_m - past[0].y_m)
        return len(past) == past.maxlen and moved_m < REST_M_S * speeds.rest_s


class ActionChooser:
    """Discrete actions as a person asks for them; satisfies `Chooser`."""

    def __init__(self, source: Controls) -> None:
        self.source = source
        self.following: Action | None = None

    def next_action(self, pose: Pose, rest: Pose | None = None) -> Action:
        """See `Chooser`; raise WaitingError if the person asks for none."""
        action, self.following = self.following, None
        if action is None and self.source.take_stop():
            return Action.STOP
        action = action if action is not None else self.source.take_action()
        if action is None:
            raise WaitingError
        return action

    def notes(self) -> list[tuple[str, str]]:
        """See `Chooser`."""
        return []


class ActionControl:
    """Discrete actions by velocity, one after another; satisfies `Controller`."""

    rate_hz = SpeedController.rate_hz

    def __init__(self, task: Task, config: SpeedConfig) -> None:
        """Drive with actions of an `ActionChooser`, which is the task's."""
        assert isinstance(task.chooser, ActionChooser)
        self._chooser, self.source = task.chooser, task.chooser.source
        self._speed = SpeedController(task, config)
        self.nominal_s = self._speed.nominal_s

    def step(self, time_s: float, pose: Pose) -> Decision:
        """See `Controller.step`; raise WaitingError if an action ends and no other is asked for."""
        decision = self.source.recorded.get(round(100 * time_s))
        if decision is None:
            return self._speed.step(time_s, pose)
        self._chooser.following = decision.action
        self._speed.step(time_s, pose)
        return decision
