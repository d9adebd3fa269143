"""Find ways up from a floor to the next over level surfaces: the treads of staircases."""

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ...formats.core.arrays import I64, Array, Mask
from ...formats.process.kernel import kernel
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
# Handrails and what holds them are no wider, seen from above.
RAIL_M = 0.15
# Staircases that join the same two levels; a building has fewer.
MOST_BETWEEN_LEVELS = 12


@dataclass(frozen=True)
class ScannedTread:
    """A tread or landing as it was scanned; the ends of a way are points of floors.

    Attributes:
        open_m: (n, 3) samples with free height above [m].
        points_m: (m, 3) all samples, also those under handrails [m].
        z_m: its height.
        clear_m: the free height above it.
    """

    open_m: Array
    points_m: Array
    z_m: float
    clear_m: float


def ways_up(
    surfaces: Surfaces, lower: ScannedFloor, upper: ScannedFloor
) -> Iterator[list[ScannedTread]]:
    """Yield the treads of each staircase, between a piece of the lower and of the upper floor.

    Staircases lie along shortest ways over level surfaces, in steps of at most `STEP_UP_M`; the
    treads under such a way are then taken out, and the next way is looked for.
    """
    grid = lower.grid
    on = [
        np.abs(surfaces.z_m - floor.z_m.ravel()[surfaces.cell]) < TREAD_STEP_M
        for floor in (lower, upper)
    ]
    index = _candidates(surfaces, on[0] | on[1], lower, upper)
    cell = surfaces.cell[index]
    xy_m = grid.center_of(np.column_stack(np.divmod(cell, grid.columns)))
    points = np.column_stack([xy_m, surfaces.z_m[index]])
    part, clear = surfaces.part[index], surfaces.clear_m[index]
    at_foot, at_head = on[0][index], on[1][index]
    level, low = at_foot | at_head, clear < PASSAGE_M
    start = np.searchsorted(cell, np.arange(grid.rows * grid.columns + 1))
    reach = int(GAP_M / grid.cell_m + 1e-6)

    def end(k: int, floor: Mask) -> ScannedTread:
        near = floor & (np.abs(points[:, :2] - points[k, :2]).max(axis=1) < AT_END_M)
        return ScannedTread(points[[k]], points[[k]], float(np.median(points[near, 2])), math.inf)

    free = np.ones(len(points), dtype=bool)
    for _ in range(MOST_BETWEEN_LEVELS):
        far, before = np.where(at_foot, 0.0, np.inf), np.full(len(points), -1)
        _search(points, cell, start, grid.shape, reach, level, low, free, at_head, far, before)
        far[~at_head] = np.inf
        if not np.isfinite(far).any():
            return
        last = int(np.argmin(far))
        nodes = _path(before, last)
        foot, head = end(nodes[0], at_foot), end(nodes[-1], at_head)
        treads = []
        for group in _groups(nodes[1:-1], points[:, 2]):
            height = np.median(points[group, 2])
            own = np.abs(points[:, 2] - height) < TREAD_STEP_M
            # A ceiling may lie in the plane of a tread.
            own &= np.isin(part, part[group]) & ~level
            open_ = own & (clear >= min(PASSAGE_M, clear[group].max()))
            # Nor does the tread end under a handrail.
            beside = KDTree(points[open_, :2]).query(points[own, :2], distance_upper_bound=RAIL_M)
            own[own] = np.isfinite(beside[0])
            treads.append(
                ScannedTread(
                    points[open_], points[own], float(height), float(np.median(clear[open_]))
                )
            )
            free[own] = False
        # What rounds the edge between a floor and the stairs is no step.
        steps = [t for t in treads if foot.z_m + TREAD_STEP_M <= t.z_m <= head.z_m - TREAD_STEP_M]
        yield [foot, *steps, head]


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


@kernel()
def _search(points, cell, start, shape, reach, level, low, free, at_head, far, before):
    """Follow the shortest ways from where `far` is 0 up to the first sample of the upper floor."""
    rows, columns = shape
    heap = [(0.0, 0)]  # numba takes the type of a list from what it first holds
    heap.pop()
    for k in range(len(far)):
        if far[k] == 0.0:
            heap.append((0.0, k))
    while len(heap) > 0:
        length, k = heapq.heappop(heap)
        if length > far[k]:
            continue
        if at_head[k]:
            return
        row, column = cell[k] // columns, cell[k] % columns
        for r in range(max(row - reach, 0), min(row + reach + 1, rows)):
            for c in range(max(column - reach, 0), min(column + reach + 1, columns)):
                for m in range(start[r * columns + c], start[r * columns + c + 1]):
                    # Ways across the floors themselves are not asked for.
                    up = points[k, 2] - points[m, 2]
                    if not free[m] or (level[k] and level[m]) or abs(up) > STEP_UP_M:
                        continue
                    step = np.hypot(points[k, 0] - points[m, 0], points[k, 1] - points[m, 1])
                    step += HIGH_STEP_PER_M * up**2
                    if low[k] or low[m]:
                        step *= STOOPING
                    if length + step < far[m]:
                        far[m], before[m] = length + step, k
                        heapq.heappush(heap, (length + step, m))


def _path(before: I64, end: int) -> list[int]:
    """Return the nodes of a shortest path, its start first."""
    nodes = [end]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return nodes[::-1]


def _groups(nodes: list[int], z_m: Array) -> list[list[int]]:
    """Divide the nodes of a path where its height changes by a step."""
    groups = [[nodes[0]]]
    for node in nodes[1:]:
        if abs(z_m[node] - z_m[groups[-1][0]]) >= TREAD_STEP_M:
            groups.append([])
        groups[-1].append(node)
    return groups
