"""Plan paths over a freemap: short, clear of obstacles, safe to follow segment by segment.

The sampler plans episodes with it, and the collectors re-plan.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates
from skimage.graph import MCP_Geometric

from ..formats.core.arrays import I64, Array, Mask
from ..formats.core.geometry import arc_length, distances_to_path, resample
from ..formats.scene.freemap import Freemap
from ..formats.scene.grid import GridSpec
from .distance import SNAP_M, nearest_cell

# The search for shortcuts: spacing of its points, how many points back a shortcut may reach, and
# what one more corner costs in metres of detour.
_STRIDE_M = 0.2
_LOOK_BACK = 30
_CORNER_M = 0.05
_PUSH = 0.15  # how much of its missing clearance a point gains per round of relaxation


@dataclass(frozen=True)
class PlanConfig:
    """Options of the choice among collision-free paths.

    Attributes:
        comfort_m: clearance beyond the robot's radius from which on more is no better [m].
        comfort_weight: how many times longer a metre feels when it grazes an obstacle.
        spacing_m: greatest distance of neighbouring waypoints [m].
        relax_steps: rounds of corner smoothing; 0 keeps the corners of the taut path.
    """

    comfort_m: float = 0.35
    comfort_weight: float = 3.0
    spacing_m: float = 0.3
    relax_steps: int = 12


def plan_path(
    freemap: Freemap,
    start_xy_m: ArrayLike,
    goal_xy_m: ArrayLike,
    radius_m: float,
    config: PlanConfig | None = None,
) -> Array | None:
    """Plan from start to goal for a disc of `radius_m`.

    A least-cost path over the grid (cost grows towards obstacles) is pulled taut where that costs
    nothing, resampled and smoothed. Every segment keeps `radius_m` of clearance, except where the
    start or the goal stands closer to an obstacle than that: there the path takes the shortest
    way out of the tight spot (a robot that has drifted must be able to leave).

    Args:
        start_xy_m, goal_xy_m: (2,) world [m]; the path starts and ends exactly there.
        radius_m: clearance that every point needs [m].

    Returns:
        (P, 3) float64 world [m] on the floor, P ≥ 2, or None if the goal cannot be reached.
    """
    config = config or PlanConfig()
    start = np.asarray(start_xy_m, dtype=np.float64)
    goal = np.asarray(goal_xy_m, dtype=np.float64)
    grid = freemap.grid
    free = freemap.free(radius_m)
    first = nearest_cell(grid, free, start, SNAP_M)
    last = nearest_cell(grid, free, goal, SNAP_M)
    if first is None or last is None:
        return None
    margin = np.clip((freemap.clearance_m - radius_m) / config.comfort_m, 0.0, 1.0)
    cost = 1.0 + config.comfort_weight * (1.0 - margin) ** 2
    try:
        finder = MCP_Geometric(np.where(free, cost, -1.0))
        finder.find_costs([first], [last])
        cells = np.array(finder.traceback(last))
    except ValueError:
        return None
    corners = _pull_taut(grid.center_of(cells), grid, free, cost)
    path = resample(_with_ends(corners, start, goal, grid, free), config.spacing_m)
    path = _relax(path, freemap, free, radius_m + config.comfort_m, config.relax_steps)
    return np.column_stack([path, floor_z(freemap, path)])


def floor_z(freemap: Freemap, xy_m: ArrayLike) -> Array:
    """Return floor heights (...) [m] at points (..., 2) [m], of the nearest cell with floor."""
    points = np.asarray(xy_m, dtype=np.float64)
    at = freemap.grid.fractional_cell_of(points.reshape(-1, 2)).T
    z = map_coordinates(freemap.floor_z_everywhere_m, at, order=1, mode="nearest")
    return z.reshape(points.shape[:-1])


def segments_free(grid: GridSpec, free: Mask, path_xy_m: ArrayLike) -> Mask:
    """Return (P − 1,) which segments of a path (P, 2) [m] stay inside the cells of `free`.

    Looks at points no farther apart than half a cell.
    """
    path = np.asarray(path_xy_m, dtype=np.float64)[:, :2]
    cells = _samples(path[:-1], path[1:], grid)
    inside = grid.inside(cells)
    cells = np.clip(cells, 0, np.array(grid.shape) - 1)
    return np.asarray((inside & free[cells[..., 0], cells[..., 1]]).all(axis=1))


def simplify_path(
    freemap: Freemap, path_m: ArrayLike, *, radius_m: float, spacing_m: float, tolerance_m: float
) -> Array:
    """Thin a path (P, 3) [m] to waypoints at its turns and at least every `spacing_m`.

    Greedy: a waypoint is as far along as the straight segment from the last one stays within
    `tolerance_m` of the path, within `spacing_m`, and free for `radius_m`. Following the straight
    segments therefore is as safe as following the path.
    """
    path = np.asarray(path_m, dtype=np.float64)
    free = freemap.free(radius_m)
    along = arc_length(path)
    # Equal spacing over the whole path looks better than one short rest at its end.
    spacing = along[-1] / max(1, int(np.ceil(along[-1] / spacing_m - 1e-9))) + 1e-9
    waypoints = [0]
    while waypoints[-1] < len(path) - 1:
        i = waypoints[-1]
        best = i + 1
        for j in range(i + 2, len(path)):
            if along[j] - along[i] > spacing:
                break
            segment = path[[i, j], :2]
            off = distances_to_path(path[i + 1 : j, :2], segment).max()
            if off <= tolerance_m and segments_free(freemap.grid, free, segment)[0]:
                best = j
        waypoints.append(best)
    return path[waypoints]


def _samples(starts: Array, ends: Array, grid: GridSpec) -> I64:
    """Return cells (N, S, 2) along N segments (N, 2) → (N, 2), at most half a cell apart."""
    longest = float(np.linalg.norm(ends - starts, axis=1).max(initial=0.0))
    count = int(np.ceil(longest / (0.5 * grid.cell_m))) + 1
    t = np.linspace(0.0, 1.0, count + 1)[None, :, None]
    return grid.cell_of(starts[:, None] * (1 - t) + ends[:, None] * t)


def _pull_taut(path: Array, grid: GridSpec, free: Mask, cost: Array) -> Array:
    """Find the cheapest polyline (K, 2) through a subset of the path's points.

    A shortcut costs the mean cost along it times its length: it is taken only where it does not
    lead closer to obstacles than its shorter way is worth.
    """
    points = path[_thinned(path, grid, free)]
    total = np.full(len(points), np.inf)
    total[0] = 0.0
    parent = np.zeros(len(points), dtype=np.int64)
    for j in range(1, len(points)):
        low = max(0, j - _LOOK_BACK)
        starts = points[low:j]
        ends = np.broadcast_to(points[j], starts.shape)
        cells = _samples(starts, ends, grid)
        linked = np.all(free[cells[..., 0], cells[..., 1]], axis=1)
        linked[-1] = True  # neighbours on the path are linked by construction
        mean = cost[cells[..., 0], cells[..., 1]].mean(axis=1)
        length = np.linalg.norm(ends - starts, axis=1)
        through = np.where(linked, total[low:j] + mean * length + _CORNER_M, np.inf)
        best = int(np.argmin(through))
        parent[j], total[j] = low + best, through[best]
    chain = [len(points) - 1]
    while chain[-1] != 0:
        chain.append(int(parent[chain[-1]]))
    return points[chain[::-1]]


def _thinned(path: Array, grid: GridSpec, free: Mask) -> I64:
    """Return indices of every few points of a path; of every point where that cuts a corner."""
    stride = max(1, round(_STRIDE_M / grid.cell_m))
    keep = np.unique(np.append(np.arange(0, len(path), stride), len(path) - 1))
    cut = np.flatnonzero(~segments_free(grid, free, path[keep]))
    between = [np.arange(keep[i], keep[i + 1]) for i in cut]
    return np.unique(np.concatenate([keep, *between]))


def _with_ends(corners: Array, start: Array, goal: Array, grid: GridSpec, free: Mask) -> Array:
    """Replace the end cells' centres by the true ends, or append those where needed."""
    if len(corners) < 2:
        return np.array([start, goal])
    first = segments_free(grid, free, np.array([start, corners[1]]))[0]
    points = np.vstack([start, corners[1 if first else 0 :]])
    last = segments_free(grid, free, np.array([points[-2], goal]))[0]
    return np.vstack([points[: -1 if last else None], goal])


def _relax(path: Array, freemap: Freemap, free: Mask, comfort_m: float, steps: int) -> Array:
    """Smooth an evenly sampled path (P, 2) as an elastic band.

    Each point moves to the middle of its neighbours and away from obstacles nearer than
    `comfort_m`; moves that leave `free` are undone (Quinlan and Khatib, "Elastic bands", 1993).
    """
    grid = freemap.grid
    path = path.copy()
    was_free = segments_free(grid, free, path)
    for _ in range(steps):
        inner = path[1:-1]
        at = grid.fractional_cell_of(inner).T
        clearance = map_coordinates(freemap.clearance_m, at, order=1, mode="nearest")
        push = _PUSH * np.maximum(comfort_m - clearance, 0.0)
        slope = [map_coordinates(g, at, order=1, mode="nearest") for g in freemap.clearance_slope]
        target = path.copy()
        target[1:-1] = 0.5 * inner + 0.25 * (path[:-2] + path[2:])
        target[1:-1] += push[:, None] * np.stack(slope, axis=1)
        for _ in range(len(path)):
            is_free = segments_free(grid, free, target)
            bad = was_free & ~is_free
            if not np.any(bad):
                break
            undo = np.append(bad, False) | np.append(False, bad)
            target[undo] = path[undo]
        else:
            is_free = segments_free(grid, free, target)
        path, was_free = target, is_free
    return path
