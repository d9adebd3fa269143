"""A level of a scene, prepared for sampling."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path
from skimage.measure import label

from ..formats.scene.bundle import SceneBundle
from ..formats.scene.freemap import Freemap
from ..wayfinding.crossings import crossings, crossings_to_the_ends
from ..wayfinding.distance import DistanceField, distance_field
from ..wayfinding.planning import segments_free
from ..wayfinding.regions import RegionMap, region_map
from .config import SampleConfig
from .ground import Visits, waypoints
from .view import SceneView

FAR_HOPS = 99  # hops between rooms that are not connected


@dataclass(frozen=True)
class LevelReach:
    """Distances from a start on a level; satisfies `Reach`."""

    field: DistanceField
    cells: NDArray[np.int64]

    @property
    def start_m(self) -> NDArray[np.float64]:
        """(2,) [m]."""
        return self.field.goal_xy_m

    @property
    def to_cells_m(self) -> NDArray[np.float64]:
        """(N,) [m]."""
        return self.field.distance_m[self.cells[:, 0], self.cells[:, 1]]

    def to(self, goal_m: NDArray[np.float64]) -> float:
        """Return the distance to a goal (2,) [m]."""
        return float(self.field.at(goal_m))


@dataclass(frozen=True)
class Level:
    """A level, prepared for sampling; satisfies `Ground`, where attributes are explained.

    Attributes:
        cells: (N, 2) cells where an episode may start or end.
        area_m2: size of the connected floors they lie on [m²].
    """

    index: int
    freemap: Freemap
    regions: RegionMap
    cells: NDArray[np.int64]
    cells_m: NDArray[np.float64]
    rooms: NDArray[np.int32]
    hops: NDArray[np.int64]
    area_m2: float
    radius_m: float
    min_crossings: int
    view: SceneView
    stairs_m: float = 0.0

    @property
    def room_names(self) -> Sequence[str]:
        """Name of every room."""
        return self.regions.names

    def route(self, path_m: NDArray[np.float64]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return this level, and no staircases."""
        return (self.index,), ()

    def reach(self, start_m: NDArray[np.float64], radius_m: float) -> LevelReach:
        """See `Ground`."""
        return LevelReach(distance_field(self.freemap, start_m, radius_m), self.cells)

    def reference(
        self, start_m: NDArray[np.float64], goal_m: NDArray[np.float64], config: SampleConfig
    ) -> NDArray[np.float64] | None:
        """See `Ground`."""
        return waypoints(self.freemap, start_m, goal_m, self.radius_m, config)

    def may_end_at(self, position_m: NDArray[np.float64]) -> bool:
        """See `Ground`."""
        cell = np.array(self.freemap.grid.cell_of(position_m[:2]))
        return bool((self.cells == cell).all(axis=1).any())

    def visits(self, reference_m: NDArray[np.float64]) -> Visits:
        """See `Ground`."""
        return visits(self.regions, reference_m)

    def is_free(self, reference_m: NDArray[np.float64]) -> bool:
        """See `Ground`."""
        free = self.freemap.free(self.radius_m)
        return bool(segments_free(self.freemap.grid, free, reference_m).all())


def visits(regions: RegionMap, path_m: NDArray[np.float64]) -> Visits:
    """Return the rooms that a path (P, 2 or 3) [m] on one level visits."""
    ends = int(regions.at(path_m[0, :2])), int(regions.at(path_m[-1, :2]))
    crossed = tuple(crossings_to_the_ends(regions, path_m))
    steps = len(crossings(regions, path_m))
    first = crossed[0].from_region if crossed else ends[0]
    return Visits(ends, (first, *(c.to_region for c in crossed)), crossed, steps)


def open_level(
    bundle: SceneBundle,
    index: int,
    radius_m: float,
    config: SampleConfig,
    regions: RegionMap,
    view: SceneView,
) -> Level:
    """Prepare a level for paths with `radius_m` of clearance.

    Only connected parts of its free floor that hold a way of `min_length_m` count. On a level
    that is a single room no path can pass between rooms, so none is asked to.
    """
    freemap = bundle.freemap(index).for_height(config.free_height_m)
    # Diagonal steps need both side cells, so neighbours by edges are what can be walked.
    parts = np.asarray(label(freemap.free(radius_m), connectivity=1))
    ends = freemap.free(config.ends_m)
    long_enough = [
        part
        for part in range(1, int(parts.max(initial=0)) + 1)
        if _holds_a_way(freemap, (parts == part) & ends, radius_m, config.min_length_m)
    ]
    wide = np.isin(parts, long_enough)
    cells = np.argwhere(wide & ends)
    area = float(wide.sum()) * freemap.grid.cell_m**2
    rooms = regions.at(freemap.grid.center_of(cells)).reshape(-1)
    cells, rooms = cells[rooms >= 0], rooms[rooms >= 0]
    min_crossings = config.min_crossings if len(np.unique(rooms)) > 1 else 0
    return Level(
        index, freemap, regions, cells, freemap.grid.center_of(cells), rooms, room_hops(regions),
        area, radius_m, min_crossings, view,
    )  # fmt: skip


def regions_of(bundle: SceneBundle) -> list[RegionMap]:
    """Return the rooms of every level of a scene."""
    return [region_map(bundle, k) for k in range(len(bundle.level_floor_z_m))]


def room_hops(regions: RegionMap) -> NDArray[np.int64]:
    """Return (R, R) fewest steps from room to room; 99 where no way leads."""
    count = len(regions.names)
    region = regions.region
    pairs = [
        np.column_stack([a.ravel(), b.ravel()])
        for a, b in ((region[:-1], region[1:]), (region[:, :-1], region[:, 1:]))
    ]
    edges = np.concatenate(pairs)
    edges = np.unique(edges[(edges >= 0).all(axis=1) & (edges[:, 0] != edges[:, 1])], axis=0)
    if not len(edges):
        return np.where(np.eye(count, dtype=bool), 0, FAR_HOPS)
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(count, count))
    hops = shortest_path(graph.tocsr(), directed=False, unweighted=True)
    return np.where(np.isfinite(hops), hops, FAR_HOPS).astype(np.int64)


def longest_way(freemap: Freemap, radius_m: float, ends_m: float) -> tuple[float, float]:
    """Return the area [m²] of the largest connected free floor and about its longest way [m].

    The way is a lower bound: the place farthest from any place is one end of a long way.
    """
    parts = np.asarray(label(freemap.free(radius_m), connectivity=1))
    if not parts.any():
        return 0.0, 0.0
    sizes = np.bincount(parts.ravel())[1:]
    cells = (parts == 1 + int(np.argmax(sizes))) & freemap.free(ends_m)
    return float(sizes.max()) * freemap.grid.cell_m**2, _sweep(freemap, cells, radius_m, np.inf)


def _holds_a_way(
    freemap: Freemap, cells: NDArray[np.bool_], radius_m: float, length_m: float
) -> bool:
    """Return whether two of `cells` (rows, columns), all connected, are `length_m` apart."""
    # No way is longer than one that visits every cell.
    if cells.sum() * freemap.grid.cell_m * np.sqrt(2) < length_m:
        return False
    return _sweep(freemap, cells, radius_m, length_m) >= length_m


def _sweep(freemap: Freemap, cells: NDArray[np.bool_], radius_m: float, enough_m: float) -> float:
    """Return about the longest way between two of `cells` [m]; stops at one of `enough_m`."""
    places = np.argwhere(cells)
    longest = 0.0
    end = places[0] if len(places) else None
    for _ in range(2):
        if end is None or longest >= enough_m:
            break
        field = distance_field(freemap, freemap.grid.center_of(end), radius_m)
        distance_m = field.distance_m[places[:, 0], places[:, 1]]
        distance_m = np.where(np.isfinite(distance_m), distance_m, 0.0)
        end, longest = places[int(np.argmax(distance_m))], float(distance_m.max())
    return longest
