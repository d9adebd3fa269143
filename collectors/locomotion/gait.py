"""The gait clock: which foot should be in the air when."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# The monomials of a calibration: which of vx, vy and yaw are multiplied.
FACTORS = tuple(f for degree in (1, 2, 3) for f in combinations_with_replacement(range(3), degree))


@dataclass(frozen=True)
class GaitClock:
    """A periodic schedule of foot swings with a plain stepping motion, stopped for standing.

    The stepping is open-loop and would fall alone; the policy's actions come on top of it. It
    spares the policy a long search for how legs move.

    Attributes:
        frequency_hz: gait cycles per second.
        foot_offsets: (F,) phase offset of each foot, in cycles; a foot swings while its phase is
            in the first half of its cycle.
        stand_rad: (J,) joint offsets [rad] that hold the weight of a standing robot: its servos
            are springs and would sag.
        swing_rad: F rows of J joint offsets [rad] at the top of each foot's swing.
        stance_rad: the same in the middle of each foot's stance.
        forward_rad, left_rad: F rows of J joint offsets [rad per m/s] at the start of each foot's
            swing for a stance that carries the foot backwards or to the right.
        foot_xy_m: (F, 2) where the feet stand under the base, for turning.
        turn_rad: F rows of J joint offsets [rad per rad/s] at the start of each foot's swing for a
            stance over which the body turns left; none for robots without such joints.
        lead_cycles: how far the reference runs ahead of the clock, because soft servos lag.
        turn_lead_s: a body's velocity trails its heading in a turn by about this time, so the steps
            aim ahead by as much.
        aim: 3 rows of coefficients of `monomials`: what to ask for beyond vx, vy and yaw so that
            they are reached; none for a gait that was not calibrated.
        aim_limits: 3 ranges of vx, vy and yaw that may be asked for.
        stand_linear_m_s, stand_yaw_rad_s: commands below both mean "stand still".
    """

    frequency_hz: float
    foot_offsets: tuple[float, ...]
    stand_rad: tuple[float, ...]
    swing_rad: tuple[tuple[float, ...], ...]
    stance_rad: tuple[tuple[float, ...], ...]
    forward_rad: tuple[tuple[float, ...], ...]
    left_rad: tuple[tuple[float, ...], ...]
    foot_xy_m: tuple[tuple[float, float], ...]
    lead_cycles: float
    turn_rad: tuple[tuple[float, ...], ...] = ()
    turn_lead_s: float = 0.0
    aim: tuple[tuple[float, ...], ...] = ()
    aim_limits: tuple[tuple[float, float], ...] = ()
    stand_linear_m_s: float = 0.03
    stand_yaw_rad_s: float = 0.05

    def moving(self, command: Array) -> NDArray[np.bool_]:
        """Whether (N, 3) commands ask for walking, (N,)."""
        linear = np.hypot(command[:, 0], command[:, 1])
        return (linear > self.stand_linear_m_s) | (np.abs(command[:, 2]) > self.stand_yaw_rad_s)

    def aimed(self, command: Array) -> Array:
        """(N, 3) what the policy and the reference must be asked for to reach (N, 3) commands."""
        if not self.aim:
            return command
        asked = command + monomials(command) @ np.array(self.aim).T
        return np.clip(asked, *np.array(self.aim_limits).T)

    def advance(self, phase: Array, moving: NDArray[np.bool_], dt_s: float) -> Array:
        """Phases (N,) in cycles after `dt_s`; a standing robot waits at phase 0."""
        return np.where(moving, (phase + self.frequency_hz * dt_s) % 1.0, 0.0)

    def foot_phase(self, phase: Array) -> Array:
        """(N, F) phase of each foot in [0, 1), swing below one half."""
        return (phase[:, None] + np.asarray(self.foot_offsets)) % 1.0

    def reference(self, phase: Array, moving: NDArray[np.bool_], command: Array) -> Array:
        """(N, J) joint offsets [rad] of the reference at phases (N,) for commands (N, 3)."""
        stand, motion, offsets, x, y = self._arrays
        angle = 2.0 * np.pi * (phase[:, None] + offsets + self.lead_cycles)
        sine, cosine = np.sin(angle), np.cos(angle)
        bump = sine * sine
        swing = bump * (sine > 0.0)
        # Half a stride ahead of the rest position at touch-down, half a stride behind at lift-off.
        vx, vy, yaw = command[:, :1], command[:, 1:2], command[:, 2:]
        ahead = self.turn_lead_s * yaw
        forward = cosine * (vx - ahead * vy - yaw * y)
        left = cosine * (vy + ahead * vx + yaw * x)
        amounts = [swing, bump - swing, forward, left]
        if self.turn_rad:
            amounts.append(cosine * yaw)
        amounts = np.concatenate(amounts, axis=1)
        return stand + (amounts @ motion) * moving[:, None]

    @cached_property
    def _arrays(self) -> tuple[Array, Array, Array, Array, Array]:
        """Stand pose, stacked motion rows, phase offsets and foot places, as arrays."""
        rows = (
            *self.swing_rad,
            *self.stance_rad,
            *self.forward_rad,
            *self.left_rad,
            *self.turn_rad,
        )
        x, y = np.array(self.foot_xy_m).T
        return np.array(self.stand_rad), np.array(rows), np.array(self.foot_offsets), x, y


def monomials(command: Array) -> Array:
    """(N, 19) monomials of degrees 1 to 3 of (N, 3) commands, without a constant."""
    return np.stack([np.prod(command[:, list(f)], axis=1) for f in FACTORS], axis=1)


def joint_targets(default_rad: Array, reference: Array, scale_rad: float, action: Array) -> Array:
    """Servo targets (N, J) [rad]: default pose and reference, plus the policy's share.

    Args:
        default_rad: (J,).
        reference: (N, J) joint offsets of the gait clock.
        scale_rad: of the actions.
        action: (N, P) for the first P ≤ J joints; the others follow the reference alone.
    """
    targets = default_rad + reference
    targets[:, : action.shape[1]] += scale_rad * action
    return targets
