"""Joint targets on their way to the motors."""

import numpy as np
from numpy.typing import NDArray

from ....formats.core.arrays import Array
from ...robots import POLICY_DECIMATION


class TargetPipe:
    """Delays joint targets by a number of physics steps, one for each of N robots."""

    def __init__(self, late_substeps: NDArray[np.intp]) -> None:
        """Get ready; `fill` comes first.

        Args:
            late_substeps: (N,) delays in physics steps, 0 or more.
        """
        substep = np.arange(POLICY_DECIMATION)
        # How many policy steps before the present one a physics step's target was given.
        self._age = np.maximum(-(-(late_substeps[:, None] - substep) // POLICY_DECIMATION), 0)
        self._kept = 1 + int(self._age.max(initial=0))
        self._robots = np.arange(len(late_substeps))[:, None]

    def fill(self, target_rad: Array) -> None:
        """Fill the pipe with the targets (N, J) [rad]."""
        self._recent = np.repeat(target_rad[None], self._kept, axis=0)

    def refill(self, robots: NDArray[np.intp], target_rad: Array) -> None:
        """Fill the pipe of some robots only, with (K, J) or (J,) targets."""
        self._recent[:, robots] = target_rad

    def push(self, target_rad: Array) -> Array:
        """Take new targets (N, J); returns what arrives, (N, physics steps, J) [rad]."""
        self._recent = np.concatenate([target_rad[None], self._recent[:-1]])
        return self._recent[self._age, self._robots]
