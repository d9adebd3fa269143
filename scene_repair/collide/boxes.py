"""Cover voxels with few axis-aligned boxes."""

import numpy as np

from ...formats.core.arrays import U8
from ...formats.process.kernel import called, kernel
from ...formats.scene.bundle import Obstacles
from .voxels import STEPS, Voxels

# What a box may do with a voxel.
NEVER, MAY, MUST = np.uint8(0), np.uint8(1), np.uint8(2)
# Growth orders over (row = y, column = x, layer = z); per box the one that covers most wins.
_ORDERS = np.array([(2, 0, 1), (2, 1, 0), (0, 1, 2), (1, 0, 2), (0, 2, 1), (1, 2, 0)])


def cover_with_boxes(voxels: Voxels, state: U8, slack: float) -> Obstacles:
    """Cover all `MUST` voxels and no `NEVER` voxel with boxes shrunk to what they cover.

    Greedy: from each voxel still open a box grows both ways along each axis in turn. It only grows
    while the extents of the surface along each of its upright sides agree to `slack` voxels, so no
    side stands out by more than that before a surface. Boxes may overlap.
    Each belongs to what owns most of the voxels that it covers.

    Args:
        voxels: tight extents of what lies in the `MUST` voxels.
        state: (rows, columns, layers) `NEVER`, `MAY` or `MUST`.
        slack: see above, in voxels.
    """
    boxes = np.empty((max(int((state == MUST).sum()), 1), 6), dtype=np.int64)
    done = np.zeros(state.shape, dtype=bool)
    extent = (voxels.lower, voxels.upper)
    count = _cover(state, extent, _ORDERS, int(slack * STEPS), done, boxes)
    boxes = boxes[:count]
    side = voxels.grid.cell_m
    corner = np.array([*voxels.grid.origin_xy_m, voxels.z0_m])
    low, high = np.empty((count, 3)), np.empty((count, 3))
    _tight(boxes, state, voxels.lower, voxels.upper, low, high)
    low, high = corner + low * side, corner + high * side
    owner = np.empty(count, dtype=np.int32)
    _majority(boxes, state, voxels.owner, owner)
    return Obstacles((low + high) / 2, (high - low) / 2, owner)


# Compiled code copies element by element: array slices would double its compile time.
@called()
def _copy(source, target):
    for k in range(len(source)):
        target[k] = source[k]


@called()
def _widen(state, extent, box, sides):
    """Include the voxels of `box` in the ranges of its upright sides; False if one is `NEVER`.

    `box` is (6,) first and last index along rows (y), columns (x), layers (z); `sides` is (12,) for
    each side (low y, high y, low x, high x) its index, and the least and most extent seen on it.
    """
    lower, upper = extent
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            for k in range(box[4], box[5] + 1):
                if state[i, j, k] == 0:
                    return False
                if state[i, j, k] == 1:
                    continue
                for side in range(4):
                    place = i if side < 2 else j
                    if place == sides[3 * side]:
                        # Extents are stored x, y while indices run y, x.
                        axis = 1 if side < 2 else 0
                        value = lower[i, j, k, axis] if side % 2 == 0 else upper[i, j, k, axis]
                        sides[3 * side + 1] = min(sides[3 * side + 1], value)
                        sides[3 * side + 2] = max(sides[3 * side + 2], value)
    return True


@called()
def _grow_box(state, extent, seed, orders, row, slack, box):
    """Grow from voxel `seed` with the growth order in `orders[row]`; leaves it in `box`."""
    sides, trial = np.empty(12, dtype=np.int64), np.empty(12, dtype=np.int64)
    slab = np.empty(6, dtype=np.int64)
    for k in range(6):
        box[k] = seed[k // 2]
    for side in range(4):
        sides[3 * side] = seed[side // 2]
        sides[3 * side + 1], sides[3 * side + 2] = 1000, -1
    _widen(state, extent, box, sides)
    for turn in range(6):
        axis, end = orders[row, turn // 2], 1 - turn % 2
        step = 1 if end == 1 else -1
        while True:
            place = box[2 * axis + end] + step
            if place < 0 or place >= state.shape[axis]:
                break
            _copy(box, slab)
            slab[2 * axis] = slab[2 * axis + 1] = place
            _copy(sides, trial)
            if axis < 2:
                # The side that moves is made of the new slab alone.
                moved = 3 * (2 * axis + end)
                trial[moved], trial[moved + 1], trial[moved + 2] = place, 1000, -1
            if not _widen(state, extent, slab, trial):
                break
            uneven = False
            for side in range(4):
                uneven |= trial[3 * side + 2] - trial[3 * side + 1] > slack
            if uneven:
                break
            _copy(trial, sides)
            box[2 * axis + end] = place


@called()
def _take(state, done, box, mark):
    """Count the open voxels in a box, and mark them as covered if `mark`."""
    count = 0
    for i in range(box[0], box[1] + 1):
        for j in range(box[2], box[3] + 1):
            for k in range(box[4], box[5] + 1):
                if state[i, j, k] == 2 and not done[i, j, k]:
                    count += 1
                    if mark:
                        done[i, j, k] = True
    return count


@kernel()
def _cover(state, extent, orders, slack, done, boxes):
    """Fill `boxes` (…, 6) and return their number."""
    count = 0
    seed, best_box = np.empty(3, dtype=np.int64), np.empty(6, dtype=np.int64)
    box = np.empty(6, dtype=np.int64)
    for i in range(state.shape[0]):
        for j in range(state.shape[1]):
            for k in range(state.shape[2]):
                if state[i, j, k] != 2 or done[i, j, k]:
                    continue
                seed[0], seed[1], seed[2] = i, j, k
                best = 0
                for row in range(len(orders)):
                    _grow_box(state, extent, seed, orders, row, slack, box)
                    gain = _take(state, done, box, False)
                    if gain > best:
                        best = gain
                        _copy(box, best_box)
                _take(state, done, best_box, True)
                for a in range(6):
                    boxes[count, a] = best_box[a]
                count += 1
    return count


@kernel()
def _tight(boxes, state, lower, upper, low, high):
    """Compute corners in voxel units, x, y, z, around the surfaces that each box covers."""
    for b in range(len(boxes)):
        for a in range(3):
            low[b, a], high[b, a] = 1e9, -1e9
        for i in range(boxes[b, 0], boxes[b, 1] + 1):
            for j in range(boxes[b, 2], boxes[b, 3] + 1):
                for k in range(boxes[b, 4], boxes[b, 5] + 1):
                    if state[i, j, k] != 2:
                        continue
                    for a in range(3):
                        base = j if a == 0 else i if a == 1 else k
                        low[b, a] = min(low[b, a], base + lower[i, j, k, a] / STEPS)
                        high[b, a] = max(high[b, a], base + upper[i, j, k, a] / STEPS)


@kernel()
def _majority(boxes, state, owner, result):
    """Find the owner of most voxels that each box covers (Boyer and Moore's vote, 1981)."""
    for b in range(len(boxes)):
        best, votes = -1, 0
        for i in range(boxes[b, 0], boxes[b, 1] + 1):
            for j in range(boxes[b, 2], boxes[b, 3] + 1):
                for k in range(boxes[b, 4], boxes[b, 5] + 1):
                    if state[i, j, k] != 2:
                        continue
                    if votes == 0:
                        best = owner[i, j, k]
                    votes += 1 if owner[i, j, k] == best else -1
        result[b] = best
