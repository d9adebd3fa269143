"""The staircases that a path takes, and its parts on the levels that they join."""

from itertools import pairwise

import numpy as np

from ...formats.core.episode import Episode
from ...formats.core.geometry import arc_length, point_along, point_along_plan
from ...formats.scene.bundle import SceneBundle
from ...wayfinding.legs import line_between
from ...wayfinding.storeys import climbable_staircase
from .geometry import Array, Track
from .records import ClimbFact

BEFORE_M = 1.5  # the direction to a staircase or a door is that from so far before it
_FLAT_M = 0.05
_STEP_M = 0.05


def climbs_of(episode: Episode, bundle: SceneBundle, track: Track) -> tuple[ClimbFact, ...]:
    """Return the staircases that an episode's path takes, in order; `track` is the path's.

    Raises:
        InputError: the scene has no such staircase, nobody can climb it, or it joins other levels.
    """
    along = np.arange(0.0, float(track.along_m[-1]) + _STEP_M, _STEP_M)
    points = point_along_plan(episode.reference_path_world_m, along)
    result = []
    for number, (before, level) in zip(episode.staircases, pairwise(episode.levels), strict=True):
        line = line_between(climbable_staircase(bundle, number), before, level)[1:-1]
        off = np.linalg.norm(points[:, None] - line, axis=-1)
        corners = [round(float(along[k]), 2) for k in off.argmin(axis=0)]
        flat = np.abs(np.diff(line[:, 2])) < _FLAT_M
        bearing_deg = track.bearing_deg(corners[0] - BEFORE_M, line[0, :2])
        landings = _landings(corners, flat.tolist())
        way = "up" if level > before else "down"
        result.append(ClimbFact(corners[0], corners[-1], level, way, bearing_deg, landings))
    return tuple(result)


def _landings(corners_m: list[float], flat: list[bool]) -> tuple[tuple[float, float], ...]:
    """Return from where to where the landings go, `flat` being whether a corner leads to one."""
    result: list[tuple[float, float]] = []
    for (low, high), level in zip(pairwise(corners_m), flat, strict=True):
        if level and result and result[-1][1] == low:
            result[-1] = (result[-1][0], high)
        elif level:
            result.append((low, high))
    return tuple(result)


def part_of(path_xy_m: Array, low_m: float, high_m: float) -> Array:
    """Return the part (Q, 2) [m] of a path (P, 2) [m] between two places along it [m]."""
    at = arc_length(path_xy_m)
    inside = path_xy_m[(at > low_m + 1e-6) & (at < high_m - 1e-6)]
    return np.vstack([point_along(path_xy_m, low_m), inside, point_along(path_xy_m, high_m)])
