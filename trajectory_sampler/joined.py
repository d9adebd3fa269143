"""Two levels that a staircase joins, prepared for sampling paths from one to the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..formats.core.arrays import I32, I64, Array
from ..formats.core.errors import SceneError
from ..formats.core.geometry import arc_length
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..wayfinding.regions import RegionMap
from ..wayfinding.storeys import End, Storeys, is_free_to_stairs
from .config import SampleConfig
from .ground import Visits, waypoints
from .level import FAR_HOPS, room_hops, visits
from .view import SceneView

# Starts and goals are at least so far from the staircase: a path goes somewhere on both levels,
# unless stairs end on a landing that is smaller.
_FROM_STAIRS_M, _ON_LANDING_M = 2.0, 1.0
_ON_FLOOR_M = 0.1  # places within this height of a level's floor are on that level


@dataclass(frozen=True)
class JoinedReach:
    """Distances from a start on one level to places on the other; satisfies `Reach`.

    Attributes:
        far: the staircase's end on the other level.
        to_far_m: distance from the start to there [m].
    """

    ground: "Joined"
    start_m: Array
    radius_m: float
    far: End
    to_far_m: float

    @property
    def to_cells_m(self) -> Array:
        """(N,) [m]."""
        field = self.ground.storeys.field_to(self.far, self.radius_m)
        row, column = field.grid.clamped_cell_of(self.ground.cells_m[:, :2]).T
        there = self.ground.sides == self.far[1]
        return np.where(there, self.to_far_m + field.distance_m[row, column], np.inf)

    def to(self, goal_m: Array) -> float:
        """Return the distance to a goal (3,) [m]."""
        field = self.ground.storeys.field_to(self.far, self.radius_m)
        return self.to_far_m + float(field.at(goal_m[:2]))


@dataclass(frozen=True)
class Joined:
    """Two levels and a staircase; satisfies `Ground`, where attributes are explained.

    Attributes:
        tight_m: clearance before the staircase's ends, where there is less room [m].
        staircase: its index in the scene.
        regions: rooms of the lower and of the upper level.
        sides: (N,) 0 for cells on the lower level, 1 for those on the upper one.
    """

    index: int
    staircase: int
    storeys: Storeys
    regions: tuple[RegionMap, RegionMap]
    cells_m: Array
    sides: I64
    rooms: I32
    hops: I64
    radius_m: float
    tight_m: float
    min_crossings: int
    view: SceneView

    @property
    def stairs_m(self) -> float:
        """Length of the staircase [m]."""
        return self.storeys.staircases[self.staircase].length_m

    @property
    def room_names(self) -> Sequence[str]:
        """Names of the rooms of both levels."""
        return (*self.regions[0].names, *self.regions[1].names)

    def route(self, path_m: Array) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """See `Ground`."""
        lower, upper = self.storeys.joins[self.staircase]
        levels = (upper, lower) if self.side(path_m[0]) else (lower, upper)
        return levels, (self.staircase,)

    def reach(self, start_m: Array, radius_m: float) -> JoinedReach:
        """See `Ground`."""
        side = self.side(start_m)
        near, far = (self.staircase, side), (self.staircase, 1 - side)
        way_m = float(self.storeys.field_to(near, radius_m).at(start_m[:2]))
        return JoinedReach(self, start_m, radius_m, far, way_m + self.stairs_m)

    def reference(self, start_m: Array, goal_m: Array, config: SampleConfig) -> Array | None:
        """See `Ground`."""
        line = self._line(start_m)
        parts = []
        for begin, end in ((start_m, line[0]), (line[-1], goal_m)):
            freemap = self._freemap(self.side(begin))
            part = waypoints(freemap, begin[:2], end[:2], self.radius_m, config)
            if part is None:
                return None
            parts.append(part)
        return np.vstack([parts[0][:-1], line, parts[1][1:]])

    def may_end_at(self, position_m: Array) -> bool:
        """See `Ground`."""
        half_m = 0.5 * self._freemap(0).grid.cell_m
        near = np.abs(self.cells_m - position_m) <= (half_m, half_m, _ON_FLOOR_M)
        return bool(near.all(axis=1).any())

    def visits(self, reference_m: Array) -> Visits:
        """See `Ground`."""
        along_m, parts = arc_length(reference_m), []
        for part in self._parts(reference_m):
            path = reference_m[part]
            side = self.side(path[0])
            own, more = visits(self.regions[side], path), side * len(self.regions[0].names)
            crossed = tuple(
                replace(
                    crossing,
                    along_m=crossing.along_m + float(along_m[part.start]),
                    from_region=crossing.from_region + more,
                    to_region=crossing.to_region + more,
                )
                for crossing in own.crossed
            )
            ends = own.ends[0] + more, own.ends[1] + more
            parts.append(
                Visits(
                    ends, tuple(room + more for room in own.rooms if room >= 0), crossed, own.steps
                )
            )
        before, after = parts
        return Visits(
            (before.ends[0], after.ends[1]),
            before.rooms + after.rooms,
            before.crossed + after.crossed,
            before.steps + 1 + after.steps,
        )

    def is_free(self, reference_m: Array) -> bool:
        """See `Ground`."""
        stairs = self.storeys.staircases[self.staircase].freemap
        paths = [reference_m[part] for part in self._parts(reference_m)]
        levels = [self._freemap(self.side(path[0])) for path in paths]
        return all(
            is_free_to_stairs(level, stairs, path, self.radius_m, self.tight_m)
            for level, path in zip(levels, paths, strict=True)
        )

    def side(self, point_m: Array) -> int:
        """Return 0 for a point (3,) [m] near the lower level, 1 near the upper one."""
        heights = self.storeys.staircases[self.staircase].line_m[[0, -1], 2]
        return int(np.argmin(np.abs(heights - point_m[2])))

    def _freemap(self, side: int) -> Freemap:
        return self.storeys.levels[self.storeys.joins[self.staircase][side]].freemap

    def _line(self, start_m: Array) -> Array:
        """Return the middle line (K, 3) [m] in the direction of a path from `start_m`."""
        return self.storeys.staircases[self.staircase].line_m[:: -1 if self.side(start_m) else 1]

    def _parts(self, reference_m: Array) -> tuple[slice, slice]:
        """Return the parts of a path before and behind the staircase, with its ends."""
        line = self._line(reference_m[0])
        first, last = (
            int(np.argmin(np.linalg.norm(reference_m - end, axis=1))) for end in line[[0, -1]]
        )
        return slice(0, first + 1), slice(last, len(reference_m))


def open_joined(
    bundle: SceneBundle,
    staircase: int,
    radius_m: float,
    config: SampleConfig,
    regions: Sequence[RegionMap],
    view: SceneView,
) -> Joined:
    """Prepare a staircase and the levels that it joins for paths with `radius_m` of clearance.

    Raises:
        SceneError: the staircase is too narrow or too low for the robot.
    """
    storeys = Storeys.of(bundle, [staircase], config.free_height_m, config.climb_height_m)
    stairs = storeys.staircases[staircase]
    width_m = bundle.staircases[staircase].width_m
    if width_m < 2 * config.robot_radius_m:
        raise SceneError(
            f"is {width_m:.2f} m wide, and the robot needs {2 * config.robot_radius_m:.2f} m"
        )
    if not stairs.lets_pass:
        raise SceneError(f"is not free along its middle, {config.climb_height_m:g} m high")
    cells, rooms = [], []
    for side, level in enumerate(storeys.joins[staircase]):
        freemap = storeys.levels[level].freemap
        way_m = storeys.field_to((staircase, side), radius_m).distance_m
        ends = freemap.free(config.ends_m) & np.isfinite(way_m)
        farthest_m = float(way_m[ends].max(initial=0.0))
        # A small landing leaves a metre of its own.
        from_stairs_m = min(_FROM_STAIRS_M, max(_ON_LANDING_M, farthest_m - _ON_LANDING_M))
        places = np.argwhere(ends & (way_m >= from_stairs_m))
        xy = freemap.grid.center_of(places)
        room = regions[level].at(xy).reshape(-1)
        heights = freemap.floor_z_m[places[:, 0], places[:, 1]].astype(np.float64)
        cells.append(np.column_stack([xy, heights])[room >= 0])
        rooms.append(room[room >= 0] + side * len(regions[storeys.joins[staircase][0]].names))
    lower, upper = (regions[level] for level in storeys.joins[staircase])
    return Joined(
        index=len(regions) + staircase,
        staircase=staircase,
        storeys=storeys,
        regions=(lower, upper),
        cells_m=np.vstack(cells),
        sides=np.repeat([0, 1], [len(places) for places in cells]),
        rooms=np.concatenate(rooms).astype(np.int32),
        hops=_hops(lower, upper, stairs.line_m),
        radius_m=radius_m,
        tight_m=config.robot_radius_m,
        min_crossings=config.min_crossings,
        view=view,
    )


def _hops(lower: RegionMap, upper: RegionMap, line_m: Array) -> I64:
    """Return (R, R) fewest steps between the rooms of both levels; the stairs are one step."""
    below, above = room_hops(lower), room_hops(upper)
    foot, head = int(lower.at(line_m[0, :2])), int(upper.at(line_m[-1, :2]))
    # Floor before stairs may belong to no room: then every room is a step from it.
    up = below[:, foot] if foot >= 0 else np.ones(len(below), dtype=np.int64)
    on = above[head] if head >= 0 else np.ones(len(above), dtype=np.int64)
    across = np.minimum(up[:, None] + 1 + on, FAR_HOPS)
    return np.block([[below, across], [across.T, above]])
