"""Geodesic distances over levels that staircases join.

One passes from level to level only along a staircase's middle line, so that distances over several
levels are sums: on each level to the end of a line, and the line's length in 3-D.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import distance_transform_edt

from ..formats.core.arrays import Array, Mask
from ..formats.core.episode import Episode
from ..formats.core.errors import InputError
from ..formats.core.geometry import arc_length, path_length, resample
from ..formats.scene import FULL_HEIGHT_M
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..formats.scene.staircase import Staircase
from .distance import AGENT_RADIUS_M, SNAP_M, DistanceField, distance_field
from .planning import floor_z, segments_free

# A point that is nearer than this to two sheets, up or down and sideways, stands on both.
_SAME_M = 0.03
_FINE_M = 0.1  # pieces of a path are free on a level or on a staircase
_BESIDE_LINE_M = 0.2  # nothing stands or hangs nearer to the middle line of stairs one climbs
_APRON_M = 0.1  # a staircase's cells within this height of a level's floor are at its ends

End = tuple[int, int]  # a staircase's index, and 0 for its foot or 1 for its head


@dataclass(frozen=True)
class Sheet:
    """The free floor of a level, or of a staircase and of the levels at its ends."""

    freemap: Freemap

    @cached_property
    def _away_m(self) -> Array:
        """Return the distances (rows, columns) [m] of the cells to the nearest free floor."""
        away = np.asarray(distance_transform_edt(~self.freemap.traversable))
        return away * self.freemap.grid.cell_m

    def away_m(self, points_m: Array) -> Array:
        """Return how far (N,) points (N, 3) [m] are from above or below this floor [m]."""
        grid = self.freemap.grid
        cells = grid.clamped_cell_of(points_m[:, :2])
        outside = np.linalg.norm(points_m[:, :2] - grid.center_of(cells), axis=1)
        return self._away_m[cells[:, 0], cells[:, 1]] + np.maximum(outside - grid.cell_m, 0.0)

    def off_m(self, points_m: Array) -> Array:
        """Return how high (N,) points (N, 3) [m] are above or below this floor [m]."""
        return np.abs(points_m[:, 2] - floor_z(self.freemap, points_m[:, :2]))


@dataclass(frozen=True)
class Stairs(Sheet):
    """The floor of a staircase, with its middle line (K, 3) going up [m]."""

    line_m: Array

    @property
    def length_m(self) -> float:
        """Length of the middle line [m]."""
        return path_length(self.line_m)

    @property
    def lets_pass(self) -> bool:
        """Return whether a walker of the height that the map is for can follow the middle line."""
        grid, free = self.freemap.grid, self.freemap.free(_BESIDE_LINE_M)
        return bool(segments_free(grid, free, self.line_m).all())

    def beside_and_along(self, points_m: Array) -> tuple[Array, Array]:
        """Return how far (N,) points (N, 3) are beside the line, and where along it [m]."""
        steps = np.diff(self.line_m, axis=0)
        to = points_m[:, None] - self.line_m[:-1]
        share = (to * steps).sum(axis=2) / np.maximum((steps**2).sum(axis=1), 1e-12)
        share = np.clip(share, 0.0, 1.0)
        off = to - share[..., None] * steps
        rows, best = np.arange(len(to)), np.argmin(np.linalg.norm(off, axis=2), axis=1)
        along = share[rows, best] * np.linalg.norm(steps[best], axis=1)
        return np.linalg.norm(off[rows, best, :2], axis=1), arc_length(self.line_m)[best] + along

    def off_m(self, points_m: Array) -> Array:
        """Return the same as for a level; a walker's base is on the slope, not on each tread."""
        along = self.beside_and_along(points_m)[1]
        slope_z = np.interp(along, arc_length(self.line_m), self.line_m[:, 2])
        return np.minimum(super().off_m(points_m), np.abs(points_m[:, 2] - slope_z))


@dataclass(frozen=True)
class Storeys:
    """Staircases of a scene and the levels that they join, by index.

    Attributes:
        joins: lower and upper level of each staircase.
    """

    levels: Mapping[int, Sheet]
    staircases: Mapping[int, Stairs]
    joins: Mapping[int, tuple[int, int]]
    _fields: dict[tuple[End, float], DistanceField] = field(
        default_factory=dict, repr=False, compare=False
    )

    @staticmethod
    def of(
        bundle: SceneBundle,
        staircases: Sequence[int],
        free_height_m: float = FULL_HEIGHT_M,
        climb_height_m: float = FULL_HEIGHT_M,
    ) -> "Storeys":
        """Return staircases of a scene, given by their indices, with the levels that they join.

        Args:
            free_height_m: above the floors of the levels [m].
            climb_height_m: above treads and the floor at their ends: what is higher blocks nothing
                there [m].

        Raises:
            InputError: the scene has no such staircase, or nobody can climb it.
        """
        records = {k: climbable_staircase(bundle, k) for k in staircases}
        joins = {k: staircase.levels for k, staircase in records.items()}
        levels = sorted({level for pair in joins.values() for level in pair})
        return Storeys(
            {k: Sheet(bundle.freemap(k).for_height(free_height_m)) for k in levels},
            {
                k: Stairs(bundle.stair_freemap(k).for_height(climb_height_m), entry.line_world_m)
                for k, entry in records.items()
            },
            joins,
        )

    @property
    def ends(self) -> list[End]:
        """Return the foot and the head of every staircase."""
        return [(k, end) for k in self.staircases for end in (0, 1)]

    def end_m(self, end: End) -> Array:
        """Return the place (3,) [m] of a staircase's foot or head, on its level."""
        return self.staircases[end[0]].line_m[(0, -1)[end[1]]]

    def level_of(self, end: End) -> int:
        """Return the level of a staircase's foot or head."""
        return self.joins[end[0]][end[1]]

    def level_at(self, point_m: ArrayLike) -> int:
        """Return the level whose floor is nearest to a point (3,) [m]."""
        point = np.asarray(point_m, dtype=np.float64)[None]
        return min(self.levels, key=lambda k: self.levels[k].off_m(point)[0])

    def field_to(self, end: End, radius_m: float) -> DistanceField:
        """Return the distances on its level to a staircase's foot or head."""
        if (end, radius_m) not in self._fields:
            freemap = self.levels[self.level_of(end)].freemap
            self._fields[end, radius_m] = distance_field(freemap, self.end_m(end)[:2], radius_m)
        return self._fields[end, radius_m]

    def distance(self, goal_m: ArrayLike, radius_m: float = AGENT_RADIUS_M) -> "StoreyDistance":
        """Return the distances to a goal (3,) [m] on one of the levels for a disc of a radius."""
        goal = np.asarray(goal_m, dtype=np.float64)
        level = self.level_at(goal)
        own = distance_field(self.levels[level].freemap, goal[:2], radius_m)
        rest = dict.fromkeys(self.ends, np.inf)
        for end in self.ends:
            if self.level_of(end) == level:
                rest[end] = float(own.at(self.end_m(end)[:2]))
        # Shortest ways between ends (Bellman and Ford): no way passes more of them than there are.
        for _ in self.ends:
            for end in self.ends:
                over = rest[end[0], 1 - end[1]] + self.staircases[end[0]].length_m
                rest[end] = min(rest[end], over)
                for other in self.ends:
                    if other != end and self.level_of(other) == self.level_of(end):
                        way = float(self.field_to(end, radius_m).at(self.end_m(other)[:2]))
                        rest[end] = min(rest[end], way + rest[other])
        return StoreyDistance(self, goal, level, radius_m, own, rest)


@dataclass(frozen=True)
class StoreyDistance:
    """Geodesic distance to one goal over the levels and staircases of `storeys`.

    Attributes:
        goal_m: (3,) [m], on level `level`.
        own: the distances on the goal's own level.
        rest_m: distance of each staircase's foot and head to the goal [m].
    """

    storeys: Storeys
    goal_m: Array
    level: int
    radius_m: float
    own: DistanceField
    rest_m: Mapping[End, float]

    def at(self, points_m: ArrayLike, within_m: float = SNAP_M) -> Array:
        """Return distances (...) [m] from points (..., 3) [m] near a floor; inf if unreachable.

        A point on a staircase goes straight to the middle line, and along it up or down.

        Args:
            within_m: see `DistanceField.at`.
        """
        points = np.asarray(points_m, dtype=np.float64)
        flat = points.reshape(-1, 3)
        levels, staircases = self.storeys.levels, self.storeys.staircases
        sheets = [*levels.values(), *staircases.values()]
        away = np.array([sheet.away_m(flat) for sheet in sheets])
        gaps = away + [sheet.off_m(flat) for sheet in sheets]
        # Off all floors, the height alone says which level a point is on.
        gaps[: len(levels)] -= np.maximum(away[: len(levels)] - SNAP_M, 0.0)
        here: Mask = gaps <= gaps.min(axis=0) + _SAME_M
        ways = np.full(gaps.shape, np.inf)
        for number, level in enumerate(levels):
            ways[number, here[number]] = self._on_level(level, flat[here[number], :2], within_m)
        for number, k in enumerate(staircases, len(levels)):
            on = here[number] & (away[number] <= within_m)
            beside, along = staircases[k].beside_and_along(flat[on])
            up = staircases[k].length_m - along + self.rest_m[k, 1]
            ways[number, on] = beside + np.minimum(along + self.rest_m[k, 0], up)
        return ways.min(axis=0).reshape(points.shape[:-1])

    def _on_level(self, level: int, xy_m: Array, within_m: float) -> Array:
        ways: list[Array] = [np.full(len(xy_m), np.inf)]
        if level == self.level:
            ways.append(self.own.at(xy_m, within_m))
        for end, rest_m in self.rest_m.items():
            if self.storeys.level_of(end) == level and np.isfinite(rest_m):
                way = self.storeys.field_to(end, self.radius_m).at(xy_m, within_m)
                ways.append(way + rest_m)
        return np.min(ways, axis=0)


def is_free_to_stairs(
    level: Freemap, stairs: Freemap, path_m: Array, level_radius_m: float, stairs_radius_m: float
) -> bool:
    """Return whether a path (P, 3) [m] on a level, to or from a staircase, is free for a disc.

    On a level its stairs are an obstacle; before and behind them their own sheet counts.

    Args:
        stairs: sheet of the staircase.
        level_radius_m, stairs_radius_m: of the disc on the level and at the staircase's ends [m].
    """
    path = resample(path_m, _FINE_M)
    apron = np.abs(stairs.floor_z_m - path[0, 2]) <= _APRON_M
    free = segments_free(level.grid, level.free(level_radius_m), path)
    free |= segments_free(stairs.grid, stairs.free(stairs_radius_m) & apron, path)
    return bool(free.all())


def climbable_staircase(bundle: SceneBundle, index: int) -> Staircase:
    """Return a staircase of a scene.

    Raises:
        InputError: the scene has no such staircase, or nobody can climb it.
    """
    try:
        bundle.stair_folder(index)
    except ValueError as error:
        raise InputError(str(error)) from error
    return bundle.staircases[index]


def distance_on(ground: Freemap | Storeys, goal_m: Array) -> DistanceField | StoreyDistance:
    """Return the distances on an episode's ground to a goal (3,) [m], or (2,) [m] on a level."""
    if isinstance(ground, Storeys):
        return ground.distance(goal_m)
    return distance_field(ground, goal_m[:2], AGENT_RADIUS_M)


def ground_of(bundle: SceneBundle, episode: Episode) -> Freemap | Storeys:
    """Return what distances of an episode are measured on: its level, or all that it joins."""
    height_m = episode.free_height_m
    if episode.staircases:
        return Storeys.of(bundle, episode.staircases, height_m, episode.climb_height_m)
    return bundle.freemap(episode.level).for_height(height_m)
