"""Ground as robots see it: the map of a depth camera has errors."""

import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array
from .terrain import Terrain

# Errors of every height, and of where all of it is, at most.
NOISE_M, SHIFT_M = 0.02, 0.02


class SeenGround:
    """A terrain in the maps of N robots: shifted, and every height a little off."""

    def __init__(self, terrain: Terrain, count: int, rng: np.random.Generator) -> None:
        self._terrain, self._rng, self._shift = terrain, rng, np.zeros((count, 1, 2))
        self.renew(np.arange(count))

    def renew(self, robots: NDArray[np.intp]) -> None:
        """Draw new shifts for the maps of some robots."""
        self._shift[robots] = self._rng.uniform(-SHIFT_M, SHIFT_M, (len(robots), 1, 2))

    def at(self, xy_m: Array) -> Array:
        """Return heights under points (N, K, 2) of N robots [m]."""
        height = self._terrain.at(xy_m + self._shift)
        return height + self._rng.uniform(-NOISE_M, NOISE_M, height.shape)
