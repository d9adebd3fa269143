"""The gait clock: which foot should be in the air when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaitClock:
    """A periodic schedule of foot swings, stopped while the robot shall stand.

    Attributes:
        frequency_hz: gait cycles per second.
        foot_offsets: (F,) phase offset of each foot, in cycles; a foot swings while its phase is
            in the first half of its cycle.
        stand_linear_m_s, stand_yaw_rad_s: commands below both mean "stand still".
    """

    frequency_hz: float
    foot_offsets: tuple[float, ...]
    stand_linear_m_s: float = 0.03
    stand_yaw_rad_s: float = 0.05

    def moving(self, command: Array) -> NDArray[np.bool_]:
        """Whether (N, 3) commands ask for walking, (N,)."""
        linear = np.hypot(command[:, 0], command[:, 1])
        return (linear > self.stand_linear_m_s) | (np.abs(command[:, 2]) > self.stand_yaw_rad_s)

    def advance(self, phase: Array, moving: NDArray[np.bool_], dt_s: float) -> Array:
        """Phases (N,) in cycles after `dt_s`; a standing robot waits at phase 0."""
        return np.where(moving, (phase + self.frequency_hz * dt_s) % 1.0, 0.0)

    def foot_phase(self, phase: Array) -> Array:
        """(N, F) phase of each foot in [0, 1), swing below one half."""
        return (phase[:, None] + np.asarray(self.foot_offsets)) % 1.0


# Diagonal pairs together (order FL, FR, RL, RR).
TROT = GaitClock(frequency_hz=2.0, foot_offsets=(0.0, 0.5, 0.5, 0.0))

GAITS: dict[str, GaitClock] = {"aliengo": TROT}
