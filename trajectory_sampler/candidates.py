"""Draw candidate paths on one level, and say why one is dropped."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.measure import label

from ..formats.core.geometry import path_length
from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..wayfinding.crossings import Crossing, crossings
from ..wayfinding.distance import AGENT_RADIUS_M, distance_field
from ..wayfinding.planning import PlanConfig, plan_path, segments_free, simplify_path
from ..wayfinding.regions import RegionMap, region_map
from .config import SampleConfig
from .similarity import path_gap


@dataclass(frozen=True)
class Candidate:
    """A path that could become an episode.

    Attributes:
        level: index of its level.
        reference_m: (P, 3) waypoints; every straight segment between them is safe [m].
        geodesic_m: length of the shortest way of VLN-CE's agent [m].
        crossed: its steps from room to room, in order.
        rooms: names of the rooms it visits, in order; "" if unknown.
        ends: room indices of its start and goal.
    """

    level: int
    reference_m: NDArray[np.float64]
    geodesic_m: float
    crossed: tuple[Crossing, ...]
    rooms: tuple[str, ...]
    ends: tuple[int, int]


@dataclass(frozen=True)
class Level:
    """One level with what sampling needs of it.

    Attributes:
        index: of the level.
        freemap: its planning map.
        regions: its rooms.
        cells: (N, 2) cells where an episode may start or end.
        rooms: (N,) room index of each of them.
        area_m2: size of the connected floor they lie on [m²].
        radius_m: clearance that every point of a path has [m].
        min_crossings: how many times a path must pass between rooms here.
    """

    index: int
    freemap: Freemap
    regions: RegionMap
    cells: NDArray[np.int64]
    rooms: NDArray[np.int32]
    area_m2: float
    radius_m: float
    min_crossings: int


def open_level(bundle: SceneBundle, index: int, radius_m: float, config: SampleConfig) -> Level:
    """Prepare a level for paths with `radius_m` of clearance.

    Only its largest connected free floor is used. On a level that is a single room no path can
    pass between rooms, so none is asked to.
    """
    freemap = bundle.freemap(index)
    regions = region_map(bundle, index)
    parts = np.asarray(label(freemap.free(radius_m), connectivity=2))
    cells = np.zeros((0, 2), dtype=np.int64)
    area = 0.0
    if parts.any():
        sizes = np.bincount(parts.ravel())[1:]
        largest = parts == 1 + int(np.argmax(sizes))
        cells = np.argwhere(largest & freemap.free(config.end_clearance_m))
        area = float(sizes.max()) * freemap.grid.cell_m**2
    rooms = regions.at(freemap.grid.center_of(cells)).reshape(-1)
    cells, rooms = cells[rooms >= 0], rooms[rooms >= 0]
    wanted = config.min_crossings if len(np.unique(rooms)) > 1 else 0
    return Level(index, freemap, regions, cells, rooms, area, radius_m, wanted)


def from_one_start(
    level: Level,
    visits: Counter[tuple[int, int]],
    kept: Sequence[NDArray[np.float64]],
    config: SampleConfig,
    rng: np.random.Generator,
) -> Iterator[Candidate | str]:
    """Draw one start and try goals from it: candidates, or the reason why one is dropped.

    Args:
        level: where.
        visits: how many kept episodes go from one room to another, by (room, room).
        kept: reference paths (P, 3) of this level's kept episodes [m].
        config: what is wanted.
        rng: the source of randomness.
    """
    grid = level.freemap.grid
    left = Counter(from_room for from_room, _ in visits.elements())
    room = _least(np.unique(level.rooms), left, rng)
    start = grid.center_of(rng.choice(level.cells[level.rooms == room]))
    field = distance_field(level.freemap, start, level.radius_m)
    way = field.distance_m[level.cells[:, 0], level.cells[:, 1]]
    fits = (way >= config.min_length_m) & (way <= config.max_length_m)
    if level.min_crossings:
        fits &= level.rooms != room
    for _ in range(config.goals_per_start):
        if not fits.any():
            yield "no_goal_in_range"
            return
        goal_rooms = np.unique(level.rooms[fits])
        used = Counter({r: visits[room, r] + visits[r, room] for r in goal_rooms.tolist()})
        goal_room = _least(goal_rooms, used, rng)
        choices = level.cells[fits & (level.rooms == goal_room)]
        yield _judge(level, start, grid.center_of(rng.choice(choices)), kept, config)


def longest_way(level: Level) -> float:
    """About how far apart two places of a level are at most [m]; a lower bound.

    The place farthest from any place is one end of a long way (two sweeps).
    """
    if not len(level.cells):
        return 0.0
    end, longest = level.cells[0], 0.0
    for _ in range(2):
        field = distance_field(level.freemap, level.freemap.grid.center_of(end), level.radius_m)
        way = field.distance_m[level.cells[:, 0], level.cells[:, 1]]
        way = np.where(np.isfinite(way), way, 0.0)
        end, longest = level.cells[int(np.argmax(way))], float(way.max())
    return longest


def _judge(
    level: Level,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    kept: Sequence[NDArray[np.float64]],
    config: SampleConfig,
) -> Candidate | str:
    plan = PlanConfig(comfort_m=config.comfort_m, comfort_weight=config.clearance_preference)
    path = plan_path(level.freemap, start, goal, level.radius_m, plan)
    if path is None:
        return "unreachable"
    reference = simplify_path(
        level.freemap,
        path,
        radius_m=level.radius_m,
        spacing_m=config.waypoint_spacing_m,
        tolerance_m=0.03,
    )
    length = path_length(reference)
    if length < config.min_length_m:
        return "too_short"
    if length > config.max_length_m:
        return "too_long"
    crossed = tuple(crossings(level.regions, reference))
    if len(crossed) < level.min_crossings:
        return "same_room"
    if path_gap(reference, kept) < config.min_gap_m:
        return "too_similar"
    if not segments_free(level.freemap.grid, level.freemap.free(level.radius_m), reference).all():
        return "unsafe"
    # Compare with what the robot could have done, not with the roomier way.
    tight = distance_field(level.freemap, goal, config.robot_radius_m)
    if length > config.max_detour * float(tight.at(start)):
        return "detour"
    geodesic = float(distance_field(level.freemap, goal, AGENT_RADIUS_M).at(start))
    if geodesic < config.min_length_m:
        return "too_short"
    ends = (int(level.regions.at(start)), int(level.regions.at(goal)))
    first = crossed[0].from_region if crossed else ends[0]
    names = tuple(level.regions.names[r] for r in (first, *(c.to_region for c in crossed)))
    return Candidate(level.index, reference, geodesic, crossed, names, ends)


def _least(rooms: NDArray[np.int32], used: Counter[int], rng: np.random.Generator) -> int:
    """One of the rooms used least so far, at random."""
    counts = np.array([used[int(r)] for r in rooms])
    return int(rng.choice(rooms[counts == counts.min()]))
