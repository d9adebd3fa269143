"""The turns along a reference path."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from ...formats.core.frames import wrap_angle

# A path is straight as far as it stays this close to a line; corners nearer than a bend's length
# to each other, the same way round, are one bend.
_STRAIGHT_M = 0.25
_BEND_M = 1.6
_BEND_RAD = np.deg2rad(120.0)
_SPOT_M = 0.6
MIN_TURN_RAD = np.deg2rad(28.0)


@dataclass(frozen=True)
class Turn:
    """A change of heading.

    Attributes:
        along_m: distance along the path of its middle [m].
        angle_rad: how far, left is positive [rad].
    """

    along_m: float
    angle_rad: float

    @property
    def direction(self) -> str:
        """`left` or `right`."""
        return "left" if self.angle_rad > 0 else "right"


def find_turns(
    path_xy_m: NDArray[np.float64],
    start_yaw_rad: float | None,
    min_turn_rad: float = MIN_TURN_RAD,
) -> tuple[Turn, ...]:
    """Find the turns along a path (P, 2) [m], by its simplified shape.

    Args:
        start_yaw_rad: heading at the start; a path that sets off in another direction begins
            with a turn. None means that it looks along the path.
        min_turn_rad: smaller changes of heading are no turns.
    """
    legs = np.diff(_corners(path_xy_m), axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    along = np.cumsum(lengths)
    found: list[Turn] = []
    for k, (before, after) in enumerate(pairwise(headings)):
        angle = float(wrap_angle(after - before))
        last = found[-1] if found else None
        if last is not None and _one_bend(last, float(along[k]) - last.along_m, angle):
            total = last.angle_rad + angle
            middle = (last.along_m * last.angle_rad + float(along[k]) * angle) / total
            found[-1] = Turn(middle, total)
        else:
            found.append(Turn(float(along[k]), angle))
    if start_yaw_rad is not None:
        angle = float(wrap_angle(headings[0] - start_yaw_rad))
        # The first leg's chord cuts the path's bend: only a clear difference is a turn.
        if abs(angle) > 2 * MIN_TURN_RAD:
            found.insert(0, Turn(0.0, angle))
    return tuple(t for t in found if abs(t.angle_rad) >= min_turn_rad)


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


def _one_bend(last: Turn, gap_m: float, angle_rad: float) -> bool:
    """Return whether a corner continues the last bend rather than being a turn of its own."""
    if np.sign(last.angle_rad) != np.sign(angle_rad):
        return False
    # Twice round a corner, as from one door into the next, is two turns unless on the spot.
    total = abs(last.angle_rad + angle_rad)
    return gap_m < (_BEND_M if total <= _BEND_RAD else _SPOT_M)
