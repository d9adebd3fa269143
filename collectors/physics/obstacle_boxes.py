"""The collision boxes that one robot could ever touch, clipped to its height and merged.

Every static geom costs time in every physics step, touched or not, so fewer boxes mean faster
physics; none of these steps changes a contact that the robot could make.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt

from ...formats.core.arrays import Array, Mask
from ...formats.scene.bundle import Obstacles
from ...formats.scene.freemap import Freemap

TOUCH_M = 1e-4  # boxes closer than this count as touching
THINNEST_M = 1e-3  # half side below which a box is widened, so that it is a solid for the solver


def robot_obstacles(
    obstacles: Obstacles, freemap: Freemap, reach_m: float, top_m: float
) -> Obstacles:
    """Return the boxes of a level within a robot's reach.

    Args:
        freemap: the level's planning map: from where a robot could reach out.
        reach_m: how far any part of the robot can be from its base, horizontally.
        top_m: world height above which the robot has no part [m]; boxes are cut there.
    """
    lower, upper = obstacles.center_m - obstacles.half_m, obstacles.center_m + obstacles.half_m
    keep = (lower[:, 2] < top_m) & _reachable(lower, upper, freemap, reach_m)
    lower, upper = lower[keep], upper[keep]
    upper[:, 2] = np.minimum(upper[:, 2], top_m)
    lower, upper = _merge(lower, upper)
    return Obstacles((lower + upper) / 2, np.maximum((upper - lower) / 2, THINNEST_M))


def _reachable(lower: Array, upper: Array, freemap: Freemap, reach_m: float) -> Mask:
    """Return (N,) bool: some part of the box is within `reach_m` of a traversable cell."""
    if not freemap.traversable.any():
        return np.zeros(len(lower), dtype=bool)
    grid = freemap.grid
    pad = int(np.ceil(reach_m / grid.cell_m)) + 1
    blocked = np.pad(~freemap.traversable, pad, constant_values=True)
    near = np.asarray(distance_transform_edt(blocked)) * grid.cell_m <= reach_m
    # Summed-area table: how many near cells lie under each box.
    table = np.zeros((near.shape[0] + 1, near.shape[1] + 1), dtype=np.int64)
    table[1:, 1:] = near.cumsum(0).cumsum(1)
    last = np.array(near.shape) - 1
    r0, c0 = np.clip(grid.cell_of(lower[:, :2]) + pad, 0, last).T
    r1, c1 = (np.clip(grid.cell_of(upper[:, :2]) + pad, 0, last) + 1).T
    return table[r1, c1] - table[r0, c1] - table[r1, c0] + table[r0, c0] > 0


def _merge(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Join boxes that share a face exactly, along z, x and y in turn, until none is left."""
    count = len(lower) + 1
    while len(lower) < count:
        count = len(lower)
        for axis in (2, 0, 1):
            lower, upper = _merge_along(lower, upper, axis)
    return lower, upper


def _merge_along(lower: Array, upper: Array, axis: int) -> tuple[Array, Array]:
    if len(lower) < 2:
        return lower, upper
    others = [a for a in range(3) if a != axis]
    profile = np.rint(np.concatenate([lower[:, others], upper[:, others]], 1) / TOUCH_M)
    order = np.lexsort((lower[:, axis], *profile.T))
    lower, upper, profile = lower[order], upper[order].copy(), profile[order]
    same = (profile[1:] == profile[:-1]).all(axis=1)
    # Within one profile boxes may overlap, so the end so far is a running maximum per group.
    group = np.concatenate([[0], np.cumsum(~same)])
    span = upper[:, axis].max() - lower[:, axis].min() + 1.0
    end = np.maximum.accumulate(upper[:, axis] + group * span) - group * span
    joined = same & (lower[1:, axis] <= end[:-1] + TOUCH_M)
    starts = np.flatnonzero(np.concatenate([[True], ~joined]))
    stops = np.append(starts[1:], len(lower)) - 1
    merged_upper = upper[starts]
    merged_upper[:, axis] = end[stops]
    return lower[starts], merged_upper
