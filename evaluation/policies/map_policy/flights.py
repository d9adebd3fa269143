"""Straight flights of stairs among the places to which a robot could step."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ....formats.core.frames import Array, wrap_angle
from .heights import CELL_M, Heights, Mask

_LOWEST_M, _FIRST_M = 0.1, 0.45  # a flight's first steps lie between these above or below its floor
_SLOPE = (0.4, 1.1)
_OFF_M = 0.12  # treads are this near to a plane
_TRIES, _CANDIDATES = 400, 8
_NEAR_M = 2.0  # of the place on the first step
_LONGEST_M = 6.0
_FEWEST = 20  # places
_NARROWEST_M, _WIDEST_M = 0.45, 2.4
TELLING_RISE_M = 0.7  # tables with shelves look like stairs so far
_FIRST_PART_M = 1.0  # tells where the flight is wide
_FOOT_ROWS, _GAP_ROWS, _MOST_ROWS = 3, 5, 80  # of cells; it ends where so many in a row are unseen
_BODY_M = (0.25, 0.6)  # what is at these heights above treads could be hit
_SHIFT_M, _ROOM_M = 0.25, 0.5
_FILLED = 0.2  # share of its area; where only risers are seen, it is a third


@dataclass(frozen=True)
class Flight:
    """A straight flight, as far as it has been seen.

    Attributes:
        foot_m: (2,) middle of the end at which the robot is [m].
        heading_rad: the way along it.
        length_m: in plan.
        width_m: of what has been seen.
        slope: rise per metre in plan.
        sign: 1 up, −1 down.
    """

    foot_m: Array
    heading_rad: float
    length_m: float
    width_m: float
    slope: float
    sign: float

    @property
    def ahead(self) -> Array:
        """(2,) unit vector along it."""
        return np.array([math.cos(self.heading_rad), math.sin(self.heading_rad)])

    def at(self, along_m: float) -> Array:
        """Return the point (2,) [m] on its middle line so far beyond its foot."""
        return self.foot_m + along_m * self.ahead

    def along_and_aside(self, points_m: Array) -> tuple[Array, Array]:
        """Return how far (N,) points (N, 2) [m] are along it and left of its middle line [m]."""
        off = points_m - self.foot_m
        return off @ self.ahead, off @ np.array([-self.ahead[1], self.ahead[0]])

    def shifted(self, left_m: float) -> "Flight":
        """Return it with its middle line moved to the left."""
        aside = np.array([-self.ahead[1], self.ahead[0]])
        return replace(self, foot_m=self.foot_m + left_m * aside)


def find_flight(
    places_m: Array,
    floor_m: float,
    sign: float,
    rng: np.random.Generator,
    *,
    least_rise_m: float = TELLING_RISE_M,
) -> Flight | None:
    """Return the flight that begins on a floor, if enough of one is seen.

    Planes through its treads are found by random samples (RANSAC); the first whose places fill
    it as steps do is the flight.

    Args:
        places_m: (N, 3) to which steps lead from that floor [m].
        floor_m: height of the floor [m].
        sign: 1 for a flight up, −1 for one down.
        least_rise_m: that must be seen.
    """
    rise = sign * (places_m[:, 2] - floor_m)
    off_floor = rise > _LOWEST_M
    places, rise = places_m[off_floor, :2], rise[off_floor]
    low = np.flatnonzero(rise < _FIRST_M)
    if len(places) < _FEWEST or len(low) < 3:
        return None
    first = rng.choice(low, _TRIES)
    others = rng.integers(len(places), size=(_TRIES, 2))
    picked = np.column_stack([first, others])
    corner = places[first]
    near = np.linalg.norm(places - corner[:, None], axis=2) < _NEAR_M
    rows = np.column_stack([places, np.ones(len(places))])
    sound = np.abs(np.linalg.det(rows[picked])) > 0.02
    sound &= np.take_along_axis(near, others, axis=1).all(axis=1)
    if not sound.any():
        return None
    planes = np.linalg.solve(rows[picked[sound]], rise[picked[sound]][..., None])[..., 0]
    slope = np.linalg.norm(planes[:, :2], axis=1)
    on = near[sound] & (np.abs(planes @ rows.T - rise) < _OFF_M)
    count = np.where((slope > _SLOPE[0]) & (slope < _SLOPE[1]), on.sum(axis=1), 0)
    for k in np.argsort(-count)[:_CANDIDATES]:
        if count[k] < _FEWEST:
            return None
        flight = _fitted(places, rise, on[k], sign, least_rise_m)
        if flight is not None:
            return flight
    return None


def _fitted(
    places: Array, rise: Array, on: Mask, sign: float, least_rise_m: float
) -> Flight | None:
    """Return the flight of the places (N,) that are on it; None if it is none."""
    middle = places[on].mean(axis=0)
    rows = np.column_stack([places - middle, np.ones(len(places))])
    near = np.linalg.norm(places - middle, axis=1) < _LONGEST_M
    plane = np.zeros(3)
    for _ in range(3):
        if on.sum() < _FEWEST:
            return None
        plane = np.linalg.lstsq(rows[on], rise[on], rcond=None)[0]
        on = near & (np.abs(rows @ plane - rise) < _OFF_M)
    slope = float(np.linalg.norm(plane[:2]))
    if not _SLOPE[0] < slope < _SLOPE[1]:
        return None
    ahead = plane[:2] / slope
    left = np.array([-ahead[1], ahead[0]])
    along, aside = (places - middle) @ ahead, (places - middle) @ left
    on &= np.abs(aside - np.median(aside[on])) < 0.5 * _WIDEST_M
    start = -float(plane[2]) / slope  # where the plane meets the floor
    first = on & (along < start + _FIRST_PART_M)
    if not first.any():
        return None
    right_m, left_m = np.quantile(aside[first], (0.03, 0.97)).tolist()
    band = near & (aside > right_m - CELL_M) & (aside < left_m + CELL_M)
    end = start + CELL_M * _rows_of_steps((along[band] - start) / CELL_M, on[band])
    on &= band & (along <= end)
    if on.sum() < _FEWEST:
        return None
    right_m, left_m = np.quantile(aside[on], (0.03, 0.97)).tolist()
    length, width = end - start, left_m - right_m
    filled = on.sum() * CELL_M**2 / (length * width) if length * width > 0 else 0.0
    if length * slope < least_rise_m or width < _NARROWEST_M or filled < _FILLED:
        return None
    foot = middle + start * ahead + 0.5 * (left_m + right_m) * left
    return Flight(foot, math.atan2(ahead[1], ahead[0]), length, width, slope, sign)


def _rows_of_steps(along_cells: Array, on: Mask) -> int:
    """Return how many rows of cells (N,) are steps: on the plane, until most of a row are not."""
    row = np.floor(along_cells).astype(np.int64)
    valid = (row >= 0) & (row < _MOST_ROWS)
    every = np.bincount(row[valid], minlength=_MOST_ROWS)
    steps = np.bincount(row[valid & on], minlength=_MOST_ROWS)
    last = -1
    for k in range(_MOST_ROWS):
        if 2 * steps[k] >= every[k] > 0:
            last = k
        elif (every[k] > 0 and k > _FOOT_ROWS) or k - last > _GAP_ROWS:
            break
    return last + 1


def with_most_room(flight: Flight, heights: Heights, floor_m: float) -> Flight:
    """Return a flight from a floor [m] with its line where walls and rails leave most room."""
    span = np.arange(-_ROOM_M, _ROOM_M + flight.length_m, CELL_M)
    along, aside = (v.ravel() for v in np.meshgrid(span, np.arange(-0.8, 0.85, 0.05)))
    left = np.array([-flight.ahead[1], flight.ahead[0]])
    points = flight.foot_m + along[:, None] * flight.ahead + aside[:, None] * left
    tread_m = floor_m + flight.sign * flight.slope * np.clip(along, 0.0, flight.length_m)
    cells = heights.grid.cell_of(points)
    in_way = heights.between(tread_m + _BODY_M[0], tread_m + _BODY_M[1], cells)
    if not in_way.any():
        return flight
    shifts = np.linspace(-_SHIFT_M, _SHIFT_M, 11)
    room = np.abs(aside[in_way] - shifts[:, None]).min(axis=1)
    best = np.argmax(np.minimum(room, _ROOM_M) - 0.2 * np.abs(shifts))
    return flight.shifted(float(shifts[best]))


def same_flight(one: Flight, other: Flight) -> bool:
    """Return whether two sights of a flight can be of the same."""
    turned = abs(float(wrap_angle(one.heading_rad - other.heading_rad)))
    return turned < math.radians(25.0) and float(np.linalg.norm(one.foot_m - other.foot_m)) < 0.7
