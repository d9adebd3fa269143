"""The gait clock schedules the swings of the feet and the joints' motion with them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from ....formats.core.arrays import I64, Array, Mask
from ....formats.process.kernel import called, kernel
from ...robots import POLICY_DECIMATION, TIMESTEP_S

# The monomials of a calibration: which of vx, vy and yaw are multiplied.
FACTORS = tuple(f for degree in (1, 2, 3) for f in combinations_with_replacement(range(3), degree))
RATE_HZ = 1.0 / (TIMESTEP_S * POLICY_DECIMATION)  # of the policy


class ClockState(NamedTuple):
    """Clocks of N robots.

    Attributes:
        command: (N, 3) vx, vy [m/s] and yaw rate [rad/s] that are followed: the target, but slowed
            down no faster than the gait can.
        phase: (N,) in cycles; 0 while standing.
        steps_left: (N,) steps that a robot still takes after its command came to nothing.
        moving: (N,) whether it steps.
        catching: (N,) policy steps for which a standing robot still steps after a push.
    """

    command: Array
    phase: Array
    steps_left: I64
    moving: Mask
    catching: I64

    @classmethod
    def standing(cls, count: int) -> ClockState:
        """Return the state of `count` robots that have not walked yet."""
        steps, moving = np.zeros((2, count), dtype=np.int64), np.zeros(count, dtype=bool)
        return cls(np.zeros((count, 3)), np.zeros(count), steps[0], moving, steps[1])


class GaitTables(NamedTuple):
    """A gait as arrays for kernels.

    Attributes:
        rates: (10,) cycles per step, `stand_linear_m_s`, `stand_yaw_rad_s`, `turn_lead_s`, greatest
            decrease of a command per step [m/s, rad/s], `last_steps`, `catch_m_s`, `catch_share`,
            policy steps of a catch.
        stand: (J,) `stand_rad`.
        motion: (5, F, J) joint offsets of swing, stance, forward, left and turn.
        feet: (F, 3) phase offset with the lead [cycles], place x, y [m].
        aim, aim_limits: (3, 19) and (3, 2), or empty without a calibration.
        factors: (19, 3) axes that a monomial multiplies; 3 stands for no further factor.
    """

    rates: Array
    stand: Array
    motion: Array
    feet: Array
    aim: Array
    aim_limits: Array
    factors: I64


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
        aim: 3 rows of coefficients of the monomials `FACTORS`: what to ask for beyond vx, vy and
            yaw so that they are reached; none for a gait that was not calibrated.
        aim_limits: 3 ranges of vx, vy and yaw that may be asked for.
        stand_linear_m_s, stand_yaw_rad_s: commands below both mean "stand still".
        brake_m_s2, brake_rad_s2: a command that falls is followed no faster than this; one that
            rises at once. None follows any jump.
        last_steps: steps taken on the spot after the command has come to nothing, so that the feet
            end side by side. 0 freezes in the middle of a step.
        catch_m_s: a standing robot whose base moves faster than this was pushed: it walks after its
            base. None stands still whatever happens.
        catch_share, catch_s: it walks with this share of that velocity for so long.
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
    catch_m_s: float | None = None
    catch_share: float = 0.8
    catch_s: float = 0.4

    @property
    def brakes(self) -> tuple[float, float]:
        """Fastest slowing down that is followed, [m/s²] and [rad/s²]; inf without a limit."""
        linear, turn = self.brake_m_s2, self.brake_rad_s2
        return math.inf if linear is None else linear, math.inf if turn is None else turn

    def moving(self, command: Array) -> Mask:
        """Return whether (N, 3) commands ask for walking, (N,)."""
        linear = np.hypot(command[:, 0], command[:, 1])
        return (linear > self.stand_linear_m_s) | (np.abs(command[:, 2]) > self.stand_yaw_rad_s)

    def aimed(self, command: Array) -> Array:
        """Return (N, 3) what policy and reference must be asked for to reach (N, 3) commands."""
        result = np.empty_like(command)
        _aim(self.tables, command, result)
        return result

    def foot_phase(self, phase: Array) -> Array:
        """Return (N, F) phase of each foot in [0, 1), swing below one half."""
        return (phase[:, None] + np.asarray(self.foot_offsets)) % 1.0

    def reference(self, phase: Array, moving: Mask, command: Array) -> Array:
        """Return (N, J) joint offsets [rad] of the reference at phases (N,) for commands (N, 3)."""
        offsets = np.empty((len(phase), len(self.stand_rad)))
        _refer(self.tables, phase, moving, command, offsets)
        return offsets

    @cached_property
    def tables(self) -> GaitTables:
        """The gait as arrays, for steps at `RATE_HZ`."""
        turn = self.turn_rad or np.zeros_like(self.swing_rad)
        rows = [self.swing_rad, self.stance_rad, self.forward_rad, self.left_rad, turn]
        rates = [
            self.frequency_hz / RATE_HZ,
            self.stand_linear_m_s,
            self.stand_yaw_rad_s,
            self.turn_lead_s,
            *(brake / RATE_HZ for brake in self.brakes),
            self.last_steps,
            math.inf if self.catch_m_s is None else self.catch_m_s,
            self.catch_share,
            round(self.catch_s * RATE_HZ),
        ]
        offsets = np.array(self.foot_offsets) + self.lead_cycles
        return GaitTables(
            rates=np.array(rates),
            stand=np.array(self.stand_rad),
            motion=np.array(rows),
            feet=np.column_stack([offsets, self.foot_xy_m]),
            aim=np.array(self.aim).reshape(-1, len(FACTORS)),
            aim_limits=np.array(self.aim_limits).reshape(-1, 2),
            factors=np.array([(*f, 3, 3)[:3] for f in FACTORS]),
        )


@called()
def catch(tables, state, body, target):
    """Let standing robots that were pushed walk after their base: overwrite `target` (N, 3).

    Args:
        body: (N, 2 or more) base velocities vx, vy [m/s] in the base frame.
    """
    rates, (command, _, _, stepping, catching) = tables.rates, state
    for n in range(len(target)):
        if np.hypot(target[n, 0], target[n, 1]) > rates[1] or abs(target[n, 2]) > rates[2]:
            catching[n] = 0
        elif catching[n] > 0:
            catching[n] -= 1
            for axis in range(3):
                target[n, axis] = command[n, axis]
        elif not stepping[n] and np.hypot(body[n, 0], body[n, 1]) > rates[7]:
            catching[n] = int(rates[9]) - 1
            command[n] = 0.0
            target[n, 0], target[n, 1] = rates[8] * body[n, 0], rates[8] * body[n, 1]


@called()
def tick(tables, state, target):
    """Advance the clocks of N robots by one step under target commands (N, 3), in place."""
    # Arrays are taken out of tuples first: numba counts references wherever one is touched.
    rates, (command, phases, steps_left, stepping, _) = tables.rates, state
    for n in range(len(target)):
        for axis in range(3):
            most = rates[5] if axis == 2 else rates[4]
            old, new = command[n, axis], target[n, axis]
            if abs(new) < abs(old) or new * old < 0.0:
                new = old + min(max(new - old, -most), most)
            command[n, axis] = new
        phase = phases[n] + rates[0]
        linear = np.hypot(command[n, 0], command[n, 1])
        moving = linear > rates[1] or abs(command[n, 2]) > rates[2]
        if moving:
            steps_left[n] = int(rates[6])
        elif steps_left[n] > 0:
            # A step ends where one foot lands and the other one is about to lift.
            if np.floor(2.0 * phase) > np.floor(2.0 * phases[n]):
                steps_left[n] -= 1
            moving = steps_left[n] > 0
        phases[n] = phase % 1.0 if moving else 0.0
        stepping[n] = moving


@called()
def aim_at(tables, target, command):
    """Write to `command` (N, 3) what must be asked for to reach `target` (N, 3)."""
    aim, limits, factors = tables.aim, tables.aim_limits, tables.factors
    for n in range(len(target)):
        for axis in range(3):
            command[n, axis] = target[n, axis]
    if not len(aim):
        return
    for n in range(len(target)):
        for term in range(len(factors)):
            value = 1.0
            for factor in factors[term]:
                if factor < 3:
                    value *= target[n, factor]
            for axis in range(3):
                command[n, axis] += aim[axis, term] * value
        for axis in range(3):
            command[n, axis] = min(max(command[n, axis], limits[axis, 0]), limits[axis, 1])


@called()
def refer(tables, phase, moving, command, offsets):
    """Write the reference's joint offsets (N, J) [rad] at phases (N,) for commands (N, 3)."""
    rates, stand, motion, feet = tables.rates, tables.stand, tables.motion, tables.feet
    for n in range(len(phase)):
        for j in range(len(stand)):
            offsets[n, j] = stand[j]
        if not moving[n]:
            continue
        vx, vy, yaw = command[n, 0], command[n, 1], command[n, 2]
        ahead = rates[3] * yaw
        for f in range(len(feet)):
            angle = 2.0 * np.pi * (phase[n] + feet[f, 0])
            sine, cosine = np.sin(angle), np.cos(angle)
            bump = sine * sine
            swing = bump if sine > 0.0 else 0.0
            # Half a stride ahead of the rest position at touch-down, as far behind at lift-off.
            forward = cosine * (vx - ahead * vy - yaw * feet[f, 2])
            left = cosine * (vy + ahead * vx + yaw * feet[f, 1])
            for j in range(len(stand)):
                offsets[n, j] += (
                    swing * motion[0, f, j]
                    + (bump - swing) * motion[1, f, j]
                    + forward * motion[2, f, j]
                    + left * motion[3, f, j]
                    + cosine * yaw * motion[4, f, j]
                )


@kernel()
def _aim(tables, target, command):
    aim_at(tables, target, command)


@kernel()
def _refer(tables, phase, moving, command, offsets):
    refer(tables, phase, moving, command, offsets)
