"""The gait clock: which foot should be in the air when."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# The monomials of a calibration: which of vx, vy and yaw are multiplied.
FACTORS = tuple(f for degree in (1, 2, 3) for f in combinations_with_replacement(range(3), degree))


@dataclass
class ClockState:
    """Where N robots are in their gait.

    Attributes:
        command: (N, 3) vx, vy [m/s] and yaw rate [rad/s] that are followed: what is wanted, but
            slowed down no faster than the gait can.
        phase: (N,) in cycles; 0 while standing.
        steps_left: (N,) steps that a robot still takes after its command came to nothing.
    """

    command: Array
    phase: Array
    steps_left: NDArray[np.intp]

    @classmethod
    def standing(cls, count: int) -> ClockState:
        """Return the state of `count` robots that have not walked yet."""
        return cls(np.zeros((count, 3)), np.zeros(count), np.zeros(count, dtype=np.intp))


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
        brake_m_s2, brake_rad_s2: a command that falls is followed no faster than this; one that
            rises at once. None follows any jump.
        last_steps: steps taken on the spot after the command has come to nothing, so that the feet
            end side by side. 0 freezes in the middle of a step.
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
    brake_m_s2: float | None = None
    brake_rad_s2: float | None = None
    last_steps: int = 0

    @property
    def brakes(self) -> tuple[float, float]:
        """Fastest slowing down that is followed, [m/s²] and [rad/s²]; inf without a limit."""
        linear, turn = self.brake_m_s2, self.brake_rad_s2
        return math.inf if linear is None else linear, math.inf if turn is None else turn

    def moving(self, command: Array) -> NDArray[np.bool_]:
        """Return whether (N, 3) commands ask for walking, (N,)."""
        linear = np.hypot(command[:, 0], command[:, 1])
        return (linear > self.stand_linear_m_s) | (np.abs(command[:, 2]) > self.stand_yaw_rad_s)

    def aimed(self, command: Array) -> Array:
        """Return (N, 3) what policy and reference must be asked for to reach (N, 3) commands."""
        if not self.aim:
            return command
        asked = command + monomials(command) @ np.array(self.aim).T
        return np.clip(asked, *np.array(self.aim_limits).T)

    def tick(
        self, state: ClockState, wanted: Array, dt_s: float
    ) -> tuple[ClockState, NDArray[np.bool_]]:
        """Return the state after `dt_s` of wanting commands (N, 3), and who is stepping (N,)."""
        linear, turn = self.brakes
        most = dt_s * np.array([linear, linear, turn])
        old = state.command
        slower = (np.abs(wanted) < np.abs(old)) | (wanted * old < 0.0)
        command = np.where(slower, old + np.clip(wanted - old, -most, most), wanted)
        asked = self.moving(command)
        stepping = asked | (state.steps_left > 0)
        phase = state.phase + self.frequency_hz * dt_s
        # A step ends where one foot lands and the other one is about to lift.
        landed = np.floor(2.0 * phase) > np.floor(2.0 * state.phase)
        left = np.where(asked, self.last_steps, state.steps_left - landed)
        stepping &= asked | (left > 0)
        left = np.where(stepping, left, 0)
        return ClockState(command, np.where(stepping, phase % 1.0, 0.0), left), stepping

    def foot_phase(self, phase: Array) -> Array:
        """Return (N, F) phase of each foot in [0, 1), swing below one half."""
        return (phase[:, None] + np.asarray(self.foot_offsets)) % 1.0

    def reference(self, phase: Array, moving: NDArray[np.bool_], command: Array) -> Array:
        """Return (N, J) joint offsets [rad] of the reference at phases (N,) for commands (N, 3)."""
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
    """Return (N, 19) monomials of degrees 1 to 3 of (N, 3) commands, without a constant."""
    return np.stack([np.prod(command[:, list(f)], axis=1) for f in FACTORS], axis=1)


def joint_targets(default_rad: Array, reference: Array, scale_rad: float, action: Array) -> Array:
    """Return servo targets (N, J) [rad]: default pose and reference, plus the policy's share.

    Args:
        default_rad: (J,).
        reference: (N, J) joint offsets of the gait clock.
        scale_rad: of the actions.
        action: (N, P) for the first P ≤ J joints; the others follow the reference alone.
    """
    targets = default_rad + reference
    targets[:, : action.shape[1]] += scale_rad * action
    return targets
