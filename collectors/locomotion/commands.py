"""Velocity commands to train and test on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..robots import CommandLimits

Array = NDArray[np.float64]

# Kinds of command and how often they come: a navigating robot mostly goes straight, turns on the
# spot, or does both at once, and stops in between.
KINDS = {"any": 0.40, "straight": 0.17, "turn": 0.17, "arc": 0.12, "stand": 0.14}


def sample_commands(
    rng: np.random.Generator, count: int, limits: CommandLimits, margin: ArrayLike = 1.0
) -> Array:
    """Random commands (count, 3), uniform within `margin` times the limits, some axes zero.

    The margin is one factor, or three: for vx, vy and yaw.
    """
    bounds = np.broadcast_to(margin, 3)[:, None] * np.array(
        [limits.vx_m_s, limits.vy_m_s, limits.yaw_rad_s]
    )
    command = rng.uniform(bounds[:, 0], bounds[:, 1], (count, 3))
    kind = rng.choice(len(KINDS), count, p=list(KINDS.values()))
    mask = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0, 0, 0]])
    return command * mask[kind]
