"""The ground under robots, also in a building whose floors lie over each other."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...formats.core.arrays import Array
from .joined_floor import STOREY_M, JoinedFloor

AHEAD_M = np.linspace(-0.5, 0.5, 26)  # of a base: where the slope of stairs is measured


class Ground(Protocol):
    """Ground under robots."""

    def at(self, xy_m: Array) -> Array:
        """Return the height under points (..., 2) in the world [m]."""
        ...


@dataclass(frozen=True)
class GroundHere:
    """The floor that a robot walks on, of several that lie over each other.

    Attributes:
        base: view of the base's position in the simulation, (3 or more,).
        base_height_m: of the base over the ground.
    """

    floor: JoinedFloor
    base: Array
    base_height_m: float

    def at(self, xy_m: Array) -> Array:
        """Return the height under points (..., 2) in the world [m]."""
        here = float(self.base[2]) - self.base_height_m
        height = self.floor.height_at(xy_m, here)
        return np.where(np.abs(height - here) < STOREY_M, height, here)


def slopes(ground: Ground, pose: Array) -> Array:
    """Return angles (N,) [rad] at which the ground rises ahead of poses (N, 3) x, y, heading."""
    ahead = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])], axis=-1)
    height = ground.at(pose[:, None, :2] + AHEAD_M[:, None] * ahead[:, None])
    return np.arctan(height @ AHEAD_M / np.sum(AHEAD_M**2))
