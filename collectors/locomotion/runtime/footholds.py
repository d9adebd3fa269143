"""Footholds of a gait on stairs, chosen 50 times a second from a height scan; compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....formats.core.arrays import I64, Array, Mask
from ....formats.process.kernel import called
from .gait import RATE_HZ

FLAT_M = 0.03  # neighbours of a foothold differ by less
REACH_M = 0.1  # a foothold is moved by no more than this
DECIDED = 0.65  # share of a swing after which its foothold is final
# Shares of a swing over which a foot rises to a higher tread, and sinks to a lower one.
RISES, SINKS = (0.0, 0.7), (0.3, 1.0)


class FootingTables(NamedTuple):
    """A `Footing` as numbers for kernels.

    Attributes:
        first_m, spacing_m: first row of the scan and distance of its rows.
        height_m: of the base.
        usual_m: how high the gait lifts its feet on level ground.
        clearance_m: see `Footing`.
        stance_s: half a stance.
        blend, servo: share per step by which the slope, and joints, follow.
        leg_m, least_m, most_m: `Footing.leg_m`.
        lean, crouch_m: see `Footing`.
        sole: rows of the scan that soles reach over, to either side.
        bearing: share of them, and of the neighbours of a point foot, that must be level.
        columns: (F,) of the scan that feet are in.
        reach, bear: (F, K, J) joint offsets for `powers` (K, 2) of a foot's shift, see `Footing`.
    """

    first_m: float
    spacing_m: float
    height_m: float
    usual_m: float
    clearance_m: float
    stance_s: float
    blend: float
    servo: float
    leg_m: float
    least_m: float
    most_m: float
    lean: float
    crouch_m: float
    sole: int
    bearing: float
    columns: I64
    reach: Array
    bear: Array
    powers: I64


class Footholds(NamedTuple):
    """Footholds of N robots.

    Attributes:
        ready: (N,) whether they have any.
        slope: (N,) rise over run of the ground, forward.
        feet: (N, F, 5) height of the last and of the next foothold in the world, how far these are
            moved forward, and how much the foot is lifted beyond a step [m].
        shift: (N, J) joint offsets that lead there [rad].
        bear: (N, J) what servos aim at beyond them, because of the weight [rad].
        shown: (2, N, J) those that the joints have followed so far [rad], and their rate [rad/s].
    """

    ready: Mask
    slope: Array
    feet: Array
    shift: Array
    bear: Array
    shown: Array

    @classmethod
    def none(cls, count: int, feet: int, joints: int) -> Footholds:
        """Return the state of robots that have not seen the ground yet."""
        return cls(
            np.zeros(count, dtype=bool),
            np.zeros(count),
            np.zeros((count, feet, 5)),
            np.zeros((count, joints)),
            np.zeros((count, joints)),
            np.zeros((2, count, joints)),
        )


@called()
def place_feet(tables, gait, footholds, scan, clock, command):
    """Choose footholds and write the joint offsets that lead there.

    Args:
        tables: `FootingTables`.
        gait: `GaitTables`.
        footholds: `Footholds`, changed in place.
        scan: (N, columns, rows) heights in the world [m].
        clock: `ClockState`.
        command: (N, 3) that the reference follows.
    """
    ready, slopes, feet, shift, bear, shown = footholds
    phase, moving, placed = clock.phase, clock.moving, gait.feet
    first, spacing, reach, powers = tables.first_m, tables.spacing_m, tables.reach, tables.powers
    for n in range(len(scan)):
        slope = _slope(tables, scan[n])
        if ready[n]:
            slope = slopes[n] + tables.blend * (slope - slopes[n])
        slopes[n] = slope
        ground = _ground(tables, scan[n], slope)
        angle = tables.lean * np.arctan(slope)
        cosine, sine = np.cos(angle), np.sin(angle)
        half = tables.stance_s * command[n, 0] * cosine if moving[n] else 0.0
        shift[n] = bear[n] = 0.0
        for f in range(len(placed)):
            level, foot = scan[n, tables.columns[f]], feet[n, f]
            home = placed[f, 1] * cosine
            cycle = (phase[n] + placed[f, 0]) % 1.0
            swing = moving[n] and cycle < 0.5
            done = 2.0 * cycle if swing else 1.0
            # Where the foot left the ground and where it will land, seen from the base now.
            since = home - half * (1.0 + 2.0 * done) + foot[2]
            to = home + half * (3.0 - 2.0 * done)
            if not ready[n]:
                foot[:] = 0.0
                foot[0] = foot[1] = _height(tables, level, home)
            elif not swing:
                foot[0], foot[2], foot[4] = foot[1], foot[3], 0.0
            elif done < DECIDED:
                chosen = _foothold(tables, level, to)
                foot[1], foot[3] = _height(tables, level, chosen), chosen - to
                # The highest ground on the way, over the straight line between its ends.
                top = -np.inf
                low = min(since, chosen) - spacing * (1 + tables.sole)
                high = max(since, chosen) + spacing * (1 + tables.sole)
                for row in range(len(level)):
                    x = first + spacing * row
                    if low < x < high:
                        top = max(top, level[row] - slope * x)
                middle = 0.5 * (foot[0] - slope * since + foot[1] - slope * chosen)
                foot[4] = max(top - middle + tables.clearance_m - tables.usual_m, foot[4])
            moved = foot[3]
            if swing:
                # Feet rise before they go forward, and sink after it.
                begin, end = RISES if foot[1] > foot[0] else SINKS
                rise = foot[0] - slope * since
                rise += _smooth((done - begin) / (end - begin)) * (
                    foot[1] - slope * (to + moved) - rise
                )
                rise += (1.0 - (2.0 * done - 1.0) ** 4) * foot[4]
                moved = foot[2] + _smooth(done) * (foot[3] - foot[2])
            else:
                # The flat reference carries the foot from half a stride ahead to as far behind.
                rise = foot[1] - slope * (home - half * np.cos(2.0 * np.pi * cycle) + moved)
            x, z = home + moved, slope * home + rise - ground - tables.height_m
            ahead = cosine * x + sine * z - placed[f, 1]
            above = cosine * z - sine * x + tables.height_m + tables.crouch_m * abs(slope)
            length = np.hypot(ahead, tables.leg_m - above)
            scale = min(max(length, tables.least_m), tables.most_m) / length
            ahead, above = scale * ahead, tables.leg_m - scale * (tables.leg_m - above)
            borne = 0.0 if swing else 1.0 if moving[n] else 1.0 / len(placed)
            for k in range(len(powers)):
                term = ahead ** powers[k, 0] * above ** powers[k, 1]
                for j in range(shift.shape[1]):
                    shift[n, j] += term * reach[f, k, j]
                    bear[n, j] += term * borne * tables.bear[f, k, j]
        for j in range(shift.shape[1]):
            if not ready[n]:
                shown[0, n, j] = shift[n, j]
            change = tables.servo * (shift[n, j] - shown[0, n, j])
            shown[0, n, j] += change
            shown[1, n, j] = change * RATE_HZ
        ready[n] = True


@called()
def see_ground(tables, footholds, scan, body, seen):
    """Write what N robots see of the ground, and their bodies as if it were level.

    Args:
        tables: `FootingTables`.
        footholds: `Footholds`.
        scan: (N, columns, rows) heights in the world [m].
        body: (N, `body_width`) changed in place: gravity turned by the trunk's pitch on the slope,
            joints without the offsets that lead to footholds.
        seen: (N, 1 + points) slope, and heights over the line through the ground; or (N, 0).
    """
    joints, rows = (body.shape[1] - 9) // 2, scan.shape[2]
    for n in range(len(scan)):
        slope = footholds.slope[n]
        angle = tables.lean * np.arctan(slope)
        cosine, sine = np.cos(angle), np.sin(angle)
        x, z = body[n, 6], body[n, 8]
        body[n, 6], body[n, 8] = cosine * x - sine * z, sine * x + cosine * z
        for j in range(joints):
            body[n, 9 + j] -= footholds.shown[0, n, j]
            body[n, 9 + joints + j] -= footholds.shown[1, n, j]
        if seen.shape[1]:
            seen[n, 0] = slope
            ground = _ground(tables, scan[n], slope)
            for column in range(scan.shape[1]):
                for row in range(rows):
                    seen[n, 1 + column * rows + row] = scan[n, column, row] - ground


@called()
def _middle(tables, rows):
    """Return how far ahead of the base the middle of the scan is."""
    return tables.first_m + 0.5 * tables.spacing_m * (rows - 1)


@called()
def _slope(tables, heights):
    """Return rise over run of the line through heights (columns, rows), by least squares."""
    raised, spread, middle = 0.0, 0.0, _middle(tables, heights.shape[1])
    for column in range(heights.shape[0]):
        for row in range(heights.shape[1]):
            x = tables.first_m + tables.spacing_m * row - middle
            raised += x * heights[column, row]
            spread += x * x
    return raised / spread


@called()
def _ground(tables, heights, slope):
    """Return the height of that line under the base."""
    return heights.mean() - slope * _middle(tables, heights.shape[1])


@called()
def _smooth(share):
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


@called()
def _height(tables, level, x):
    """Return the height (rows,) under a foot at x: at the highest row under its sole."""
    row = int(np.rint((x - tables.first_m) / tables.spacing_m))
    row = min(max(row, 0), len(level) - 1)
    return level[max(row - tables.sole, 0) : row + tables.sole + 1].max()


@called()
def _foothold(tables, level, x):
    """Return where the ground bears a foot, as near to x as possible; x if it does so nowhere.

    Of a sole, which rests on the highest row under it, a share may stand out over an edge. A foot
    that lands beyond the scan, as on level ground at speed, stays where it would land there.
    """
    best, chosen = REACH_M, x
    around = max(tables.sole, 1)
    rows_ahead = (x - tables.first_m) / tables.spacing_m
    if not around - 0.5 <= rows_ahead <= len(level) - around - 0.5:
        return x
    for row in range(around, len(level) - around):
        at = tables.first_m + tables.spacing_m * row
        far = abs(at - x)
        if far < best:
            rest = level[row - tables.sole : row + tables.sole + 1].max()
            rows = np.abs(level[row - around : row + around + 1] - rest) < FLAT_M
            if rows.mean() >= tables.bearing:
                best, chosen = far, at
    return x if best < 0.5 * tables.spacing_m else chosen
