"""When each robot in training gets a new command, and when it is pushed."""

import numpy as np
from numpy.typing import NDArray

from ...robots import RobotSpec
from ..runtime.gait import GaitClock
from ..trials.aim import command_bounds
from ..trials.trial import STEP_S
from .config import TrainingConfig
from .randomize import ACTION_S, sample_actions, sample_commands

Array = NDArray[np.float64]
NEAR_S = 0.4  # what comes later than this hardly matters to the critic yet


class Schedule:
    """Commands and kicks of N robots, the present and the next ones.

    `age` is the number of policy steps (N,) since each robot's reset.

    Attributes:
        target: (N, 3) present velocity command [m/s, m/s, rad/s].
        kick: (N, 2) next change of the base's velocity, in the world [m/s].
    """

    def __init__(
        self, robot: RobotSpec, config: TrainingConfig, gait: GaitClock, rng: np.random.Generator
    ) -> None:
        n = config.envs
        self._config, self._gait, self._rng = config, gait, rng
        self._bounds = command_bounds(
            robot.command_limits, config.command_margin, config.command_beyond
        )
        self._hurried = rng.random(n) < config.hurried_share
        self.target, self._upcoming = np.zeros((n, 3)), np.zeros((n, 3))
        self._next_command_s, self._upcoming_s = np.zeros(n), np.zeros(n)
        self.kick, self._next_push_s = np.zeros((n, 2)), np.zeros(n)

    def reset(self, ids: NDArray[np.intp], age: NDArray[np.int64]) -> None:
        """Restart the schedule of robots `ids`, whose age is 0."""
        self.target[ids] = 0.0
        self._next_command_s[ids] = 0.0
        self._next_push_s[ids] = self._rng.uniform(*self._config.push_s, len(ids))
        self._draw_kick(ids)
        self._draw_command(ids)
        self.change_commands(age)

    def change_commands(self, age: NDArray[np.int64]) -> None:
        """Give new commands to those whose time has come; every other one stops after a walk."""
        due = np.flatnonzero(age * STEP_S >= self._next_command_s)
        if not len(due):
            return
        self.target[due] = self._upcoming[due]
        self._next_command_s[due] = age[due] * STEP_S + self._upcoming_s[due]
        self._draw_command(due)

    def kicks(self, age: NDArray[np.int64]) -> tuple[NDArray[np.intp], Array]:
        """Return the robots (K,) whose time for a kick has come, and their kicks (K, 2)."""
        due = np.flatnonzero(age * STEP_S >= self._next_push_s)
        kicks = self.kick[due]
        if len(due):
            wait = self._rng.uniform(*self._config.push_s, len(due))
            self._next_push_s[due] = age[due] * STEP_S + wait
            self._draw_kick(due)
        return due, kicks

    def future(self, age: NDArray[np.int64], kick: Array) -> Array:
        """Return (N, 10) command, next command and `kick`, weighted by how near these are."""
        soon, kick_soon = (
            np.exp(-np.maximum(at - age * STEP_S, 0.0) / NEAR_S)[:, None]
            for at in (self._next_command_s, self._next_push_s)
        )
        parts = [self.target, self._upcoming * soon, soon, kick * kick_soon, kick_soon]
        return np.concatenate(parts, axis=1)

    def _draw_command(self, due: NDArray[np.intp]) -> None:
        """Draw the commands that follow the present ones, and how long they will last."""
        rng, config = self._rng, self._config
        walked = self._gait.moving(self.target[due])
        stop = walked & (rng.random(len(due)) < config.stop_share)
        hurried = self._hurried[due]
        wait = rng.uniform(*config.command_s, len(due))
        wait = np.where(stop, rng.uniform(*config.stop_s, len(due)), wait)
        fresh = sample_commands(rng, len(due), self._bounds)
        # Like discrete actions in VLN-PE's timing: a step or a turn each quarter of a second.
        wait[hurried] = ACTION_S * rng.integers(1, 5, hurried.sum())
        fresh[hurried] = sample_actions(rng, int(hurried.sum()))
        stop &= ~hurried | (rng.random(len(due)) < 0.2)
        wait[hurried & stop] = rng.uniform(*config.stop_s, int((hurried & stop).sum()))
        self._upcoming[due] = np.where(stop[:, None], 0.0, fresh)
        self._upcoming_s[due] = wait

    def _draw_kick(self, due: NDArray[np.intp]) -> None:
        angle = self._rng.uniform(0, 2 * np.pi, len(due))
        kick = self._config.push_m_s * self._rng.uniform(0.3, 1, len(due))
        self.kick[due] = kick[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
