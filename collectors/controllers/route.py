"""A dense route along a reference path, with arc length, heading and curvature."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import Array
from ...formats.core.geometry import arc_length, space_evenly
from ...formats.scene.freemap import Freemap
from ...wayfinding.planning import plan_path, segments_free
from .interface import Pose

STEP_M = 0.05
_CURVE_M = 0.25  # headings are compared over this length before and after a point


@dataclass(frozen=True)
class Route:
    """A polyline with points about `STEP_M` apart.

    Attributes:
        xy_m: (N, 2) world [m], N ≥ 2.
        along_m: (N,) arc length from the start [m].
        problems: what could not be planned, one line each.
    """

    xy_m: Array
    along_m: Array
    problems: tuple[str, ...] = ()

    @property
    def length_m(self) -> float:
        """Length of the whole route [m]."""
        return float(self.along_m[-1])

    @property
    def heading_rad(self) -> Array:
        """(N,) direction of travel at each point, continuous (unwrapped) [rad]."""
        step = np.gradient(self.xy_m, axis=0)
        return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))

    @property
    def turning_rad(self) -> float:
        """Sum of all changes of direction [rad]."""
        return float(np.abs(np.diff(self.heading_rad)).sum())

    def curvature_per_m(self) -> Array:
        """Return absolute changes of direction (N,), over `_CURVE_M` to each side [1/m]."""
        heading, reach = self.heading_rad, max(1, round(_CURVE_M / STEP_M))
        padded = np.pad(heading, reach, mode="edge")
        return np.abs(padded[2 * reach :] - padded[: -2 * reach]) / (2 * _CURVE_M)


def make_route(xy_m: ArrayLike, problems: tuple[str, ...] = ()) -> Route:
    """Divide a polyline (P, 2) [m] evenly: corners are cut by half a step at most."""
    xy = space_evenly(xy_m, STEP_M)
    if len(xy) == 1:
        xy = np.repeat(xy, 2, axis=0)
    along = arc_length(xy)
    return Route(xy, along, problems)


def plan_route(freemap: Freemap, waypoints_xy_m: ArrayLike, radius_m: float) -> Route:
    """Plan a route through waypoints (P, 2) [m] that keeps `radius_m` free where possible.

    Straight segments that are free are kept as they are. A blocked one is planned around; where
    there is no way at all the straight segment stays, and `problems` describes it: the robot tries,
    and the rollout records the result.
    """
    points = np.asarray(waypoints_xy_m, dtype=np.float64)[:, :2]
    if len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    free = segments_free(freemap.grid, freemap.free(radius_m), points)
    pieces, problems = [points[:1]], []
    for k, is_free in enumerate(free):
        start, end = points[k], points[k + 1]
        piece = None if is_free else plan_path(freemap, start, end, radius_m)
        if not is_free and piece is None:
            problems.append(
                f"no way from ({start[0]:.2f}, {start[1]:.2f}) to ({end[0]:.2f}, {end[1]:.2f}) "
                f"for radius {radius_m:.2f} m"
            )
        pieces.append(end[None] if piece is None else piece[1:, :2])
    return make_route(np.concatenate(pieces), tuple(problems))


def rejoin(freemap: Freemap, pose: Pose, rest_xy_m: Array, radius_m: float) -> Route | None:
    """Return the way from `pose` to the first of the points (R, 2) and along them, or None."""
    back = plan_path(freemap, np.array([pose.x_m, pose.y_m]), rest_xy_m[0], radius_m)
    return None if back is None else make_route(np.vstack([back[:, :2], rest_xy_m]))
