"""Measure flights of stairs: their risers, treads, width and direction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from .floor_parts import PASSAGE_M
from .treads import ScannedTread

# What people build to be walked up without hands. Its halves have one direction.
STEEPEST_RISER_M, SHORTEST_GOING_M, NARROWEST_M, STRAIGHT_DEG = 0.22, 0.2, 0.6, 20.0
# So much of each tread lies where evenly spaced risers of its flight put it, within this distance.
REGULAR_SHARE, REGULAR_M = 0.75, 0.04
LEAST_POINTS = 3  # of a tread that has long and short sides


@dataclass(frozen=True)
class Flight:
    """A run of steps without a landing.

    Attributes:
        levels: the two levels that its staircase joins, lower first.
        foot_world_m, head_world_m: (3,) middle of the first and of the last riser, at the height
            below the first and above the last.
        direction_world_deg: of going up, from x towards y.
        risers_m: (n,) heights of its risers, lowest first.
        going_m: horizontal distance from one riser to the next.
        width_m: of its treads, where there is free height above.
        sides_m: how far its treads reach to its right and left from the middle of its risers.
        headroom_m: least free height over its treads; inf under the open sky.
        problem: why a person could not walk it upright; empty if one could.
    """

    levels: tuple[int, int]
    foot_world_m: Array
    head_world_m: Array
    direction_world_deg: float
    risers_m: Array
    going_m: float
    width_m: float
    sides_m: tuple[float, float]
    headroom_m: float
    problem: str

    @property
    def ahead(self) -> Array:
        """(2,) horizontal unit vector of going up."""
        angle = np.radians(self.direction_world_deg)
        return np.array([np.cos(angle), np.sin(angle)])


def measure_flight(
    treads: Sequence[ScannedTread], levels: tuple[int, int], cell_m: float
) -> Flight:
    """Measure a flight from what lies before its first riser to what lies behind its last.

    Args:
        treads: at least two lie between the first and the last.
        cell_m: distance of their samples.
    """
    steps = treads[1:-1]
    middle = np.array([t.points_m[:, :2].mean(axis=0) for t in steps])
    ahead = _ahead(steps, _step(middle))
    across = np.array([-ahead[1], ahead[0]])
    along = [t.points_m[:, :2] @ ahead for t in steps]
    going, first_along = _evenly(middle @ ahead)
    foot_along = first_along - going / 2
    open_ = _sides([t.open_m for t in steps], across, cell_m)
    right, left = _sides([t.points_m for t in steps], across, cell_m)
    foot = foot_along * ahead + sum(open_) / 2 * across
    head = foot + len(steps) * going * ahead
    risers = np.diff([t.z_m for t in treads])
    headroom = min(t.clear_m for t in steps)
    width = open_[1] - open_[0]
    off = [
        np.mean(np.abs(u - foot_along - (k + 0.5) * going) > going / 2 + REGULAR_M)
        for k, u in enumerate(along)
    ]
    half = max(2, (len(steps) + 1) // 2)
    first, second = _step(middle[:half]), _step(middle[-half:])
    cross = first[0] * second[1] - first[1] * second[0]
    turn = np.degrees(np.arctan2(abs(cross), first @ second))
    problem = ""
    if headroom < PASSAGE_M:
        problem = f"has {headroom:.2f} m of free height above it"
    elif turn > STRAIGHT_DEG:
        problem = f"winds by {turn:.0f}°"
    elif risers.max() > STEEPEST_RISER_M or going < SHORTEST_GOING_M:
        problem = f"is steep: risers up to {100 * risers.max():.0f} cm, treads {100 * going:.0f} cm"
    elif width < NARROWEST_M:
        problem = f"is {width:.2f} m wide"
    elif max(off) > 1 - REGULAR_SHARE:
        problem = f"is irregular: tread {int(np.argmax(off)) + 1} is not where the others put it"
    return Flight(
        levels=levels,
        foot_world_m=np.array([*foot, treads[0].z_m]),
        head_world_m=np.array([*head, treads[-1].z_m]),
        direction_world_deg=float(np.degrees(np.arctan2(ahead[1], ahead[0]))),
        risers_m=risers,
        going_m=going,
        width_m=width,
        sides_m=(sum(open_) / 2 - right, left - sum(open_) / 2),
        headroom_m=headroom,
        problem=problem,
    )


def _ahead(steps: Sequence[ScannedTread], step: Array) -> Array:
    """Return the unit vector across the treads' long sides, in the direction of `step` (2,)."""
    angles = []
    for tread in steps:
        if len(tread.points_m) < LEAST_POINTS:
            continue
        _, axes = np.linalg.eigh(np.cov(tread.points_m[:, :2].T))
        # A tread is wider than it is long; its axes change roles if it is not.
        axis = axes.T[np.argmax(np.abs(step @ axes))]
        angles.append(np.arctan2(step[0] * axis[1] - step[1] * axis[0], step @ axis))
    turn = np.median((np.array(angles or [0.0]) + np.pi / 2) % np.pi - np.pi / 2)
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s], [s, c]]) @ step / np.linalg.norm(step)


def _evenly(along_m: Array) -> tuple[float, float]:
    """Return the distance between treads and where the first one lies, from their middles (n,).

    By least squares, without those that were scanned in part.
    """
    count = np.arange(len(along_m))
    first, second = np.triu_indices(len(along_m), 1)
    step = np.median((along_m[second] - along_m[first]) / (second - first))
    off = along_m - step * count
    whole = np.abs(off - np.median(off)) <= REGULAR_M / 2
    if whole.sum() < 2:
        return float(step), float(np.median(off))
    slope, start = np.polyfit(count[whole], along_m[whole], 1)
    return float(slope), float(start)


def _sides(points_m: Sequence[Array], across: Array, cell_m: float) -> tuple[float, float]:
    """Return where treads end to the right and to the left along `across`, by their medians."""
    ends = np.array([(p[:, :2] @ across).min() for p in points_m])
    others = np.array([(p[:, :2] @ across).max() for p in points_m])
    return float(np.median(ends)) - cell_m / 2, float(np.median(others)) + cell_m / 2


def _step(middle_m: Array) -> Array:
    """Return (2,) from one tread to the next, from their middles (n, 2), n > 1.

    A median, because a tread that was scanned in part moves its middle.
    """
    first, second = np.triu_indices(len(middle_m), 1)
    return np.median((middle_m[second] - middle_m[first]) / (second - first)[:, None], axis=0)
