"""Which staircase of a repaired scene the path of a VLN-CE episode takes, and its way there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.geometry import distances_to_path
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...wayfinding.storeys import Storeys, is_free_to_stairs
from .levels import STAIRS, Part, RejectedError, level_gaps, place_text

_ON_FLOOR_M = 0.3  # a point no farther above or below a level's floor is on that level
_BESIDE_M = 1.2  # a point on a staircase is no farther from its middle line
_END_M = 1.0  # farthest that a start or goal floats


@dataclass(frozen=True)
class Climb:
    """How a path changes levels.

    Attributes:
        levels: of its start and its goal.
        before, behind: how many points at its start, and at its end, lie on them; 1 or more.
    """

    storeys: Storeys
    levels: tuple[int, int]
    staircase: int
    before: int
    behind: int

    @property
    def line_m(self) -> Array:
        """Middle line (K, 3) of the staircase, in the direction of the path [m]."""
        first, last = self.levels
        return self.storeys.staircases[self.staircase].line_m[:: 1 if first < last else -1]


def climb_of(
    bundle: SceneBundle,
    freemaps: Sequence[Freemap],
    path_m: Array,
    *,
    radius_m: float,
    free_height_m: float,
    climb_height_m: float,
) -> Climb | str:
    """Return how a path (P, 3) [m] takes one climbable staircase, or why it takes none.

    Args:
        freemaps: of the scene's levels.
        radius_m: of the robot that is to walk it [m].
        free_height_m, climb_height_m: see `Storeys.of`.
    """
    gaps = np.abs(level_gaps(freemaps, path_m))
    first, last = (int(np.argmin(gaps[:, end])) for end in (0, -1))
    if max(gaps[first, 0], gaps[last, -1]) > _END_M:
        return "its start or its goal lies on no level's floor"
    if first == last:
        return f"it starts and ends on level {first}, so it takes no staircase between levels"
    ends = {first, last}
    candidates = [(k, s) for k, s in enumerate(bundle.staircases) if set(s.levels) == ends]
    if not candidates:
        return f"no staircase joins levels {first} and {last}"
    before = _leading(gaps[first] <= _ON_FLOOR_M)
    behind = _leading(gaps[last, ::-1] <= _ON_FLOOR_M)
    if not before or not behind:
        return f"it {'ends' if before else 'starts'} on the stairs"
    between = path_m[before : len(path_m) - behind]
    reasons = []
    for k, staircase in candidates:
        beside = distances_to_path(between, staircase.line_world_m) if len(between) else np.zeros(1)
        if staircase.problem:
            reasons.append(staircase.problem)
        elif beside.max() > _BESIDE_M:
            reasons.append(f"is {beside.max():.1f} m from its path")
        elif staircase.width_m < 2 * radius_m:
            reasons.append(f"is {staircase.width_m:.2f} m wide")
        else:
            storeys = Storeys.of(bundle, [k], free_height_m, climb_height_m)
            if not storeys.staircases[k].lets_pass:
                reasons.append(f"is not free along its middle, {climb_height_m:g} m high")
            elif _reached(storeys, path_m, radius_m):
                return Climb(storeys, (first, last), k, before, behind)
            else:
                reasons.append(f"is not reached by a robot of radius {radius_m:g} m")
    return "; ".join(
        f"staircase {k} {why}" for (k, _), why in zip(candidates, reasons, strict=True)
    )


def around_stairs(climb: Climb, points: Array, names: list[str]) -> list[Part]:
    """Return the parts of a path (P, 3) [m] before and behind the middle line of its stairs."""
    count, line = len(points), climb.line_m
    before = list(range(climb.before))
    behind = list(range(count - climb.behind, count))
    # Points past a line's end would lead back to it.
    while len(before) > 1 and _is_past(points[before[-1]], line[0], line):
        before.pop()
    while len(behind) > 1 and _is_past(points[behind[0]], line[-1], line):
        behind.pop(0)
    parts = []
    for level, own, called in (
        (climb.levels[0], [*points[before], line[0]], [*(names[k] for k in before), STAIRS]),
        (climb.levels[1], [line[-1], *points[behind]], [STAIRS, *(names[k] for k in behind)]),
    ):
        points_m = np.array(own)
        freemap = climb.storeys.levels[level].freemap
        (gaps,) = level_gaps([freemap], points_m)
        gaps = np.where(np.isinf(gaps), 0.0, gaps)
        parts.append(Part(freemap, points_m, called, gaps))
    return parts


def joined(climb: Climb, before: Array, behind: Array, radius_m: float) -> Array:
    """Return a path (P, 3) [m] over a staircase along its middle line.

    Args:
        before: (Q, 3) part of the path up to the place of the line's first point on its level [m].
        behind: (R, 3) part from the place of its last point [m].
        radius_m: of the robot that is to walk it [m].

    Raises:
        RejectedError: the way from a part to the line is not free.
    """
    line, stairs = climb.line_m, climb.storeys.staircases[climb.staircase].freemap
    ways = []
    for level, end, part in zip(climb.levels, line[[0, -1]], (before[::-1], behind), strict=True):
        floor, (place, neighbour) = climb.storeys.levels[level].freemap, part[:2]

        def is_free(point: Array, end: Array = end, floor: Freemap = floor) -> bool:
            return is_free_to_stairs(floor, stairs, np.array([end, point]), radius_m, radius_m)

        same = np.linalg.norm(place[:2] - end[:2]) < 1e-6
        if same or is_free(neighbour):
            part = part[1:]
        elif not is_free(place):
            raise RejectedError(
                f"an obstacle stands between {place_text(place)} and the end of staircase "
                f"{climb.staircase} at {place_text(end)}, for a robot of radius {radius_m:g} m"
            )
        ways.append(part)
    return np.vstack([ways[0][::-1], line, ways[1]])


def _is_past(point: Array, end: Array, line: Array) -> bool:
    """Return whether a point (3,) is beside a line (K, 3) rather than before its end."""
    beside = distances_to_path(point[None], line)[0]
    return bool(beside < np.linalg.norm(point - end) - 1e-6)


def _leading(flags: np.ndarray) -> int:
    """Return how many of the flags (N,) are set before the first that is not."""
    return int(np.argmin(flags)) if not flags.all() else len(flags)


def _reached(storeys: Storeys, path_m: Array, radius_m: float) -> bool:
    """Return whether start and goal of a path (P, 3) [m] are joined for a robot."""
    return bool(np.isfinite(storeys.distance(path_m[-1], radius_m).at(path_m[0])))
