"""Schedules of new commands and pushes for the robots in training."""

import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import I64, Array
from ...robots import RobotSpec
from ..trials.aim import command_bounds
from ..trials.trial import STEP_S
from .config import TrainingConfig
from .randomize import sample_commands

NEAR_S = 0.4  # what comes later than this hardly matters to the critic yet


class Schedule:
    """Commands and kicks of N robots, the present and the next ones.

    `age` is the number of policy steps (N,) since each robot's reset.

    Attributes:
        target: (N, 3) present velocity command [m/s, m/s, rad/s].
        kick: (N, 2) next change of the base's velocity, in the world [m/s].
    """

    def __init__(self, robot: RobotSpec, config: TrainingConfig, rng: np.random.Generator) -> None:
        n = config.envs
        self._config, self._rng = config, rng
        self._bounds = command_bounds(
            robot.command_limits, config.command_margin, config.command_beyond
        )
        self.target, self._upcoming = np.zeros((n, 3)), np.zeros((n, 3))
        self._next_command_s, self._upcoming_s = np.zeros(n), np.zeros(n)
        self.kick, self._next_push_s = np.zeros((n, 2)), np.zeros(n)

    def reset(self, ids: NDArray[np.intp], age: I64) -> None:
        """Restart the schedule of robots `ids`, whose age is 0."""
        self.target[ids] = 0.0
        self._next_command_s[ids] = 0.0
        self._next_push_s[ids] = self._rng.uniform(*self._config.push_s, len(ids))
        self._draw_kick(ids)
        self._draw_command(ids)
        self.change_commands(age)

    def change_commands(self, age: I64) -> None:
        """Give new commands to the robots whose time has come."""
        due = np.flatnonzero(age * STEP_S >= self._next_command_s)
        if not len(due):
            return
        self.target[due] = self._upcoming[due]
        self._next_command_s[due] = age[due] * STEP_S + self._upcoming_s[due]
        self._draw_command(due)

    def kicks(self, age: I64) -> tuple[NDArray[np.intp], Array]:
        """Return the robots (K,) whose time for a kick has come, and their kicks (K, 2)."""
        due = np.flatnonzero(age * STEP_S >= self._next_push_s)
        kicks = self.kick[due]
        if len(due):
            wait = self._rng.uniform(*self._config.push_s, len(due))
            self._next_push_s[due] = age[due] * STEP_S + wait
            self._draw_kick(due)
        return due, kicks

    def future(self, age: I64, kick: Array) -> Array:
        """Return (N, 10) command, next command and `kick`, weighted by how near these are."""
        soon, kick_soon = (
            np.exp(-np.maximum(at - age * STEP_S, 0.0) / NEAR_S)[:, None]
            for at in (self._next_command_s, self._next_push_s)
        )
        parts = [self.target, self._upcoming * soon, soon, kick * kick_soon, kick_soon]
        return np.concatenate(parts, axis=1)

    def _draw_command(self, due: NDArray[np.intp]) -> None:
        """Draw the commands that follow the present ones, and how long they will last."""
        self._upcoming_s[due] = self._rng.uniform(*self._config.command_s, len(due))
        self._upcoming[due] = sample_commands(self._rng, len(due), self._bounds)

    def _draw_kick(self, due: NDArray[np.intp]) -> None:
        angle = self._rng.uniform(0, 2 * np.pi, len(due))
        kick = self._config.push_m_s * self._rng.uniform(0.3, 1, len(due))
        self.kick[due] = kick[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
