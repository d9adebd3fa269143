"""The points of a VLN-CE episode in its scene, and on which level they lie."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...formats.core.frames import HABITAT_TO_WORLD, Array, transform_points
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...formats.vlnce.files import VlnceEpisode
from ...wayfinding.distance import nearest_cell
from ...wayfinding.planning import floor_z

FLOOR_REACH_M = 0.5  # floor this far from a point still counts as the floor under it
STAIRS = "staircase"  # name of the point where a part of a path meets a staircase


class RejectedError(Exception):
    """An episode cannot be aligned; the message says why."""


@dataclass(frozen=True)
class Part:
    """A part of a path on one level, before and after it was fitted.

    Attributes:
        points_m: (P, 3) as in the file [m], from start to goal.
        names: (P,) of the points.
        gaps_m: (P,) heights of the points above the floor [m].
    """

    freemap: Freemap
    points_m: Array
    names: list[str]
    gaps_m: Array


def world_from(raw: VlnceEpisode, bundle: SceneBundle) -> Array:
    """Return the (4, 4) transform of an episode's positions into the world of its scene."""
    return HABITAT_TO_WORLD if raw.in_repaired_world else bundle.habitat_to_world


def points_of(raw: VlnceEpisode, bundle: SceneBundle) -> Array:
    """Return the start, reference path and first goal (P, 3) [m] of an episode in its scene."""
    goal = raw.goals[0].position_habitat_m
    points = (raw.start_position_habitat_m, raw.reference_path_habitat_m, goal)
    return np.vstack([transform_points(world_from(raw, bundle), part) for part in points])


def level_under(freemaps: Sequence[Freemap], points: Array, max_gap_m: float) -> tuple[int, Array]:
    """Return the level under a path (P, 3) [m], and the heights above its floor (P,) [m].

    Its ends must lie on that floor. Inner points without floor nearby are compared with the level's
    usual height: at a hole they can be bypassed, on stairs they are too high or too low.

    Raises:
        RejectedError: a point lies farther than `max_gap_m` [m] from every level's floor.
    """
    gaps = level_gaps(freemaps, points)
    for freemap, inner in zip(freemaps, gaps[:, 1:-1], strict=True):
        if np.isfinite(freemap.floor_z_m).any():
            usual_m = float(np.nanmedian(freemap.floor_z_m))
            inner[:] = np.where(np.isinf(inner), points[1:-1, 2] - usual_m, inner)
    worst = np.abs(gaps).max(axis=1)
    level = int(np.argmin(worst))
    if worst[level] <= max_gap_m:
        return level, gaps[level]
    # Say what is wrong by the level that most of the path lies on.
    level = int(np.argmin(np.median(np.abs(gaps), axis=1)))
    point = int(np.argmax(np.abs(gaps[level])))
    gap = gaps[level, point]
    where = f"of level {level} at {place_text(points[point])}"
    if not np.isfinite(gap):
        raise RejectedError(f"there is no floor {where}")
    raise RejectedError(
        f"a point lies {abs(gap):.2f} m {'above' if gap > 0 else 'below'} the floor {where}; "
        f"at most {max_gap_m:g} m is allowed (the path may change levels)"
    )


def level_gaps(freemaps: Sequence[Freemap], points_m: Array) -> Array:
    """Return the heights (levels, P) of points (P, 3) [m] above every level's floor [m].

    A height is infinite where the level has no floor nearby.
    """
    return np.array([_floor_gaps(freemap, points_m) for freemap in freemaps])


def _floor_gaps(freemap: Freemap, points_m: Array) -> Array:
    has_floor = np.isfinite(freemap.floor_z_m)
    if not has_floor.any():
        return np.full(len(points_m), np.inf)
    gaps = points_m[:, 2] - floor_z(freemap, points_m[:, :2])
    cells = [nearest_cell(freemap.grid, has_floor, p, FLOOR_REACH_M) for p in points_m[:, :2]]
    return np.where([cell is not None for cell in cells], gaps, np.inf)


def place_text(point: Array) -> str:
    """Return a point as in error messages."""
    return "(" + ", ".join(f"{v:.2f}" for v in point) + ")"
