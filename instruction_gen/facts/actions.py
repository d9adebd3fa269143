"""The turns along a reference path."""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ...formats.core.frames import wrap_angle
from .records import TurnFact

# A path is straight as far as it stays this close to a line; corners nearer than a bend's length
# to each other, the same way round, are one bend.
_STRAIGHT_M = 0.25
_BEND_M, _BEND_RAD = 1.6, np.deg2rad(120.0)
_SPOT_M = 0.6
_SMALLEST_RAD, _AT_START_RAD = np.deg2rad(20.0), np.deg2rad(56.0)


def find_turns(path_xy_m: NDArray[np.float64], start_yaw_rad: float) -> tuple[TurnFact, ...]:
    """Find the turns along a path (P, 2) [m], by its simplified shape.

    A path that sets off in another direction than that of `start_yaw_rad` begins with a turn.
    """
    legs = np.diff(_corners(path_xy_m), axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    along = np.cumsum(lengths)
    found: list[tuple[float, float]] = []  # along the path [m], angle [rad]
    for k, (before, after) in enumerate(pairwise(headings)):
        angle = float(wrap_angle(after - before))
        at_m, last = found[-1] if found else (-np.inf, 0.0)
        if found and _one_bend(last, angle, float(along[k]) - at_m):
            total = last + angle
            found[-1] = ((at_m * last + float(along[k]) * angle) / total, total)
        else:
            found.append((float(along[k]), angle))
    # The first leg's chord cuts the path's bend: only a clear difference is a turn.
    angle = float(wrap_angle(headings[0] - start_yaw_rad))
    found = ([(0.0, angle)] if abs(angle) > _AT_START_RAD else []) + found
    return tuple(
        TurnFact(round(at_m, 2), round(float(np.rad2deg(angle)), 1))
        for at_m, angle in found
        if abs(angle) >= _SMALLEST_RAD
    )


def _corners(path_xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (C, 2) [m] of a path's simplified shape, its ends included."""
    far = int(np.argmax(np.linalg.norm(path_xy_m - path_xy_m[0], axis=1)))
    closed = np.linalg.norm(path_xy_m[-1] - path_xy_m[0]) < _STRAIGHT_M
    if closed and 0 < far < len(path_xy_m) - 1:
        # Distances to the line from start to end say nothing where a path comes back.
        there, back = _corners(path_xy_m[: far + 1]), _corners(path_xy_m[far:])
        return np.concatenate([there, back[1:]])
    line = np.ascontiguousarray(path_xy_m, dtype=np.float32)[:, None]
    return cv2.approxPolyDP(line, _STRAIGHT_M, closed=False)[:, 0].astype(np.float64)


def _one_bend(last_rad: float, angle_rad: float, gap_m: float) -> bool:
    """Return whether a corner continues the last bend rather than being a turn of its own."""
    # Twice round a corner, as from one door into the next, is two turns unless on the spot.
    near_m = _BEND_M if abs(last_rad + angle_rad) <= _BEND_RAD else _SPOT_M
    return np.sign(last_rad) == np.sign(angle_rad) and gap_m < near_m
