"""Velocity commands to train and test on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..robots import CommandLimits

Array = NDArray[np.float64]

# Kinds of command and how often they come: a navigating robot mostly goes straight, turns on the
# spot, or does both at once, and stops in between.
KINDS = {"any": 0.40, "straight": 0.17, "turn": 0.17, "arc": 0.12, "stand": 0.14}

ACTION_S = 0.25  # of a discrete action in VLN-PE's timing
ACTIONS = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, np.pi / 3), (0.0, 0.0, -np.pi / 3)])


def command_bounds(
    limits: CommandLimits, margin: float = 1.0, beyond: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """(3, 2) least and greatest vx, vy and yaw: the limits times `margin`, and `beyond` more."""
    bounds = margin * np.array([limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s])
    return bounds + np.asarray(beyond)[:, None] * (-1.0, 1.0)


def sample_commands(rng: np.random.Generator, count: int, bounds: Array) -> Array:
    """Random commands (count, 3), uniform within bounds (3, 2) of `command_bounds`; some axes 0."""
    command = rng.uniform(bounds[:, 0], bounds[:, 1], (count, 3))
    kind = rng.choice(len(KINDS), count, p=list(KINDS.values()))
    mask = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0, 0, 0]])
    return command * mask[kind]


def sample_actions(rng: np.random.Generator, count: int) -> Array:
    """Commands (count, 3) of discrete actions as VLN-PE times them: half steps, half turns."""
    return ACTIONS[rng.choice(3, count, p=(0.5, 0.25, 0.25))]
