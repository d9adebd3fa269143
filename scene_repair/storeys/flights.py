"""Recognise flights of stairs: their risers, treads, width and direction, and what they join."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from ...formats.core.arrays import I64, Array, Mask
from ..grid.morphology import grow, label
from .floor_parts import PASSAGE_M
from .levels import ScannedFloor
from .surfaces import Surfaces

# A step is no higher than this, and may leave this much of the plan open between its treads.
STEP_UP_M, GAP_M = 0.31, 0.08
# A way goes up step by step and takes no two at once, from beside them: the square of a step's
# height counts as so much length.
HIGH_STEP_PER_M = 20.0
# Nor does it go where nobody could stand, unless there is no other: so many times as long.
STOOPING = 10.0
# What has less than this over it is no tread; boards of a bookcase are further apart than a step.
COVERED_M = 0.15
# Heights that differ by less belong to one tread.
TREAD_STEP_M = 0.05
# Floor this near to a staircase's end gives its height there.
AT_END_M = 0.2
# A tread with more than this many times the usual area is a landing.
LANDING_AREAS = 1.7
# Fewer risers than this make a step, not a flight.
LEAST_RISERS = 3
# What people build to be walked up without hands. Its halves have one direction.
STEEPEST_RISER_M, SHORTEST_GOING_M, NARROWEST_M, STRAIGHT_DEG = 0.22, 0.2, 0.6, 20.0
# Staircases that join the same two levels; a building has fewer.
MOST_BETWEEN_LEVELS = 12


@dataclass(frozen=True)
class Flight:
    """A run of steps without a landing.

    Attributes:
        levels: the two levels that its staircase joins, lower first.
        foot_world_m, head_world_m: (3,) middle of the first and of the last riser, at the height
            below the first and above the last.
        direction_world_deg: of going up, from x towards y.
        risers_m: (n,) heights of its risers, lowest first.
        going_m: horizontal distance from one riser to the next.
        width_m: of its treads.
        headroom_m: least free height over its treads; inf under the open sky.
        problem: why a person could not walk it upright; empty if one could.
    """

    levels: tuple[int, int]
    foot_world_m: Array
    head_world_m: Array
    direction_world_deg: float
    risers_m: Array
    going_m: float
    width_m: float
    headroom_m: float
    problem: str


@dataclass(frozen=True)
class _Tread:
    """Samples (n, 3) [m] of one tread or landing, its height, and the free height above it."""

    points_m: Array
    z_m: float
    clear_m: float


def find_flights(surfaces: Surfaces, floors: list[ScannedFloor]) -> list[Flight]:
    """Return the flights of all staircases between neighbouring levels, in order of walking up.

    Staircases lie along shortest ways over level surfaces, from a floor to the floor above in steps
    of at most `STEP_UP_M`; the treads under such a way are then taken out, and the next way is
    looked for.
    """
    flights = []
    for k, (lower, upper) in enumerate(pairwise(floors)):
        for treads in _staircases(surfaces, lower, upper):
            flights.extend(_flights(treads, (k, k + 1), lower.grid.cell_m))
    return flights


def _staircases(
    surfaces: Surfaces, lower: ScannedFloor, upper: ScannedFloor
) -> Iterator[list[_Tread]]:
    """Yield the treads of each staircase, between a piece of the lower and of the upper floor."""
    grid = lower.grid
    on = [
        np.abs(surfaces.z_m - floor.z_m.ravel()[surfaces.cell]) < TREAD_STEP_M
        for floor in (lower, upper)
    ]
    index = _candidates(surfaces, on[0] | on[1], lower, upper)
    row, column = np.divmod(surfaces.cell[index], grid.columns)
    points = np.column_stack([grid.center_of(np.column_stack([row, column])), surfaces.z_m[index]])
    part, clear = surfaces.part[index], surfaces.clear_m[index]
    at_foot, at_head = on[0][index], on[1][index]
    # A ball of radius 1 in these units reaches over a gap in plan and one step in height.
    pairs = KDTree(points / (GAP_M, GAP_M, STEP_UP_M)).query_pairs(
        1.0, p=np.inf, output_type="ndarray"
    )
    # Ways across the floors themselves are not asked for.
    level = at_foot | at_head
    pairs = pairs[~(level[pairs[:, 0]] & level[pairs[:, 1]])]
    gap = np.abs(points[pairs[:, 0]] - points[pairs[:, 1]])
    length = np.hypot(gap[:, 0], gap[:, 1]) + HIGH_STEP_PER_M * gap[:, 2] ** 2
    length *= np.where(clear[pairs].min(axis=1) < PASSAGE_M, STOOPING, 1.0)
    size = len(points)

    def end(k: int, floor: Mask) -> _Tread:
        near = floor & (np.abs(points[:, :2] - points[k, :2]).max(axis=1) < AT_END_M)
        return _Tread(points[[k]], float(np.median(points[near, 2])), math.inf)

    free = np.ones(size, dtype=bool)
    for _ in range(MOST_BETWEEN_LEVELS):
        kept = free[pairs].all(axis=1)
        graph = csr_array((length[kept], pairs[kept].T), shape=(size, size))
        far, before, _ = dijkstra(
            graph,
            directed=False,
            indices=np.flatnonzero(at_foot),
            min_only=True,
            return_predecessors=True,
        )
        far = np.where(at_head, far, np.inf)
        last = int(np.argmin(far)) if size else 0
        if not np.isfinite(far[last : last + 1]).any():
            return
        way = _way(before, last)
        treads = [end(way[0], at_foot)]
        for group in _groups(way[1:-1], points[:, 2]):
            height = np.median(points[group, 2])
            own = np.abs(points[:, 2] - height) < TREAD_STEP_M
            # A ceiling may lie in the plane of a tread.
            own &= np.isin(part, part[group]) & (clear >= min(PASSAGE_M, clear[group].max()))
            own &= ~level
            treads.append(_Tread(points[own], float(height), float(np.median(clear[own]))))
            free[own] = False
        yield [*treads, end(way[-1], at_head)]


def _candidates(surfaces: Surfaces, level: Mask, lower: ScannedFloor, upper: ScannedFloor) -> I64:
    """Return the samples of what may be stairs, and of the floors around it.

    Stairs are where surfaces between two floors have heights without a gap larger than a step, from
    the lower to the upper floor.
    """
    grid = lower.grid
    between = (surfaces.z_m > lower.floor_z_m) & (surfaces.z_m < upper.floor_z_m) & ~level
    between &= surfaces.clear_m >= COVERED_M
    plan = np.zeros(grid.shape, dtype=bool)
    plan.ravel()[surfaces.cell[between]] = True
    area = label(grow(plan, math.ceil(GAP_M / grid.cell_m)), diagonal=True)[0].ravel()
    own = np.where(between, area[surfaces.cell], 0)
    stairs = [
        k
        for k in np.unique(own[between])
        if np.diff([lower.floor_z_m, *np.sort(surfaces.z_m[own == k]), upper.floor_z_m]).max()
        < STEP_UP_M
    ]
    return np.flatnonzero((between | level) & np.isin(area[surfaces.cell], stairs))


def _way(before: I64, end: int) -> list[int]:
    """Return the nodes of a shortest way, its start first."""
    way = [end]
    while before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return way[::-1]


def _groups(way: list[int], z_m: Array) -> list[list[int]]:
    """Divide the nodes of a way where its height changes by a step."""
    groups = [[way[0]]]
    for node in way[1:]:
        if abs(z_m[node] - z_m[groups[-1][0]]) >= TREAD_STEP_M:
            groups.append([])
        groups[-1].append(node)
    return groups


def _flights(treads: list[_Tread], levels: tuple[int, int], cell_m: float) -> Iterator[Flight]:
    """Yield the flights of a staircase, divided by its landings."""
    sizes = np.array([len(t.points_m) for t in treads], dtype=np.float64)
    usual = np.median(sizes[1:-1]) if len(treads) > 2 else 0.0
    landings = np.flatnonzero(sizes > LANDING_AREAS * usual)
    ends = np.unique([0, *landings, len(treads) - 1])
    for first, last in pairwise(ends):
        if last - first >= LEAST_RISERS:
            yield _flight(treads[first : last + 1], levels, cell_m)


def _flight(treads: list[_Tread], levels: tuple[int, int], cell_m: float) -> Flight:
    """Measure a flight from what lies before its first riser to what lies behind its last."""
    steps = treads[1:-1]
    middle = np.array([t.points_m[:, :2].mean(axis=0) for t in steps])
    step = _step(middle)
    going = float(np.linalg.norm(step))
    ahead = step / going
    across = np.array([-ahead[1], ahead[0]])
    half = (len(steps) + 1) // 2
    first, second = _step(middle[:half]), _step(middle[-half:])
    turn = np.degrees(np.arccos(first @ second / np.linalg.norm(first) / np.linalg.norm(second)))
    width = cell_m + float(np.median([np.ptp(t.points_m[:, :2] @ across) for t in steps]))
    risers = np.diff([t.z_m for t in treads])
    foot = np.median(middle - np.arange(len(steps))[:, None] * step, axis=0) - step / 2
    head = foot + len(steps) * step
    headroom = min(t.clear_m for t in steps)
    problem = ""
    if headroom < PASSAGE_M:
        problem = f"has {headroom:.2f} m of free height above it"
    elif turn > STRAIGHT_DEG:
        problem = f"winds by {turn:.0f}°"
    elif risers.max() > STEEPEST_RISER_M or going < SHORTEST_GOING_M:
        problem = f"is steep: risers up to {100 * risers.max():.0f} cm, treads {100 * going:.0f} cm"
    elif width < NARROWEST_M:
        problem = f"is {width:.2f} m wide"
    return Flight(
        levels=levels,
        foot_world_m=np.array([*foot, treads[0].z_m]),
        head_world_m=np.array([*head, treads[-1].z_m]),
        direction_world_deg=float(np.degrees(np.arctan2(ahead[1], ahead[0]))),
        risers_m=risers,
        going_m=going,
        width_m=width,
        headroom_m=headroom,
        problem=problem,
    )


def _step(middle_m: Array) -> Array:
    """Return (2,) from one tread to the next, from their middles (n, 2), n > 1.

    A median, because a tread that was scanned in part moves its middle.
    """
    first, second = np.triu_indices(len(middle_m), 1)
    return np.median((middle_m[second] - middle_m[first]) / (second - first)[:, None], axis=0)
