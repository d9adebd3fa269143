"""Greedy merging of voxels into few axis-aligned boxes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..formats.scene_bundle import Obstacles
from .voxels import STEPS, Voxels

# Growth orders over (row = y, column = x, layer = z); the one that needs fewest boxes wins.
_ORDERS = ((2, 0, 1), (2, 1, 0))


def merge_boxes(voxels: Voxels, occupied: NDArray[np.bool_], slack: float = 0.5) -> Obstacles:
    """Cover the occupied voxels with boxes, each shrunk to the tight extent of what it covers.

    A box only grows while the extents along each of its upright sides agree to `slack` voxels, so
    no side stands out by more than that before a surface: half a voxel by default.

    Args:
        voxels: tight extents.
        occupied: (rows, columns, layers) bool; voxels without an extent of their own (the inside
            of solid things) count as full.
        slack: see above, in voxels.
    """
    lower, upper = voxels.lower.copy(), voxels.upper.copy()
    inside = occupied & ~voxels.occupied
    lower[inside], upper[inside] = 0, STEPS
    found = [_grow(occupied, lower, upper, np.array(o), int(slack * STEPS)) for o in _ORDERS]
    boxes = min(found, key=len)
    side = voxels.grid.cell_m
    corner = np.array([*voxels.grid.origin_xy_m, voxels.z0_m])
    low, high = _tight(boxes, lower, upper)
    low, high = corner + low * side, corner + high * side
    return Obstacles((low + high) / 2, (high - low) / 2)


@njit(cache=True)
def _agrees(occupied, lower, upper, used, low, high, slack):
    """Whether all voxels low … high are free to take and each upright side is even."""
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            for k in range(low[2], high[2] + 1):
                if not occupied[i, j, k] or used[i, j, k]:
                    return False
    for axis in range(2):
        # Extents are stored x, y, z while indices run y, x, z.
        extent = 1 - axis
        for end in range(2):
            least, most = 255, 0
            a0, a1 = low[0], high[0]
            b0, b1 = low[1], high[1]
            if axis == 0:
                a0 = a1 = low[0] if end == 0 else high[0]
            else:
                b0 = b1 = low[1] if end == 0 else high[1]
            for i in range(a0, a1 + 1):
                for j in range(b0, b1 + 1):
                    for k in range(low[2], high[2] + 1):
                        value = lower[i, j, k, extent] if end == 0 else upper[i, j, k, extent]
                        least, most = min(least, value), max(most, value)
            if most - least > slack:
                return False
    return True


@njit(cache=True)
def _grow(occupied, lower, upper, order, slack):
    """Boxes (N, 6) int32: first and last index along rows (y), columns (x), layers (z)."""
    shape = occupied.shape
    used = np.zeros(shape, dtype=np.bool_)
    boxes = np.empty((max(int(occupied.sum()), 1), 6), dtype=np.int32)
    count = 0
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(shape[0]):
        for j in range(shape[1]):
            for k in range(shape[2]):
                if not occupied[i, j, k] or used[i, j, k]:
                    continue
                low[0], low[1], low[2] = i, j, k
                high[:] = low
                for axis in order:
                    while high[axis] + 1 < shape[axis]:
                        high[axis] += 1
                        if not _agrees(occupied, lower, upper, used, low, high, slack):
                            high[axis] -= 1
                            break
                for a in range(low[0], high[0] + 1):
                    for b in range(low[1], high[1] + 1):
                        for c in range(low[2], high[2] + 1):
                            used[a, b, c] = True
                for a in range(3):
                    boxes[count, 2 * a] = low[a]
                    boxes[count, 2 * a + 1] = high[a]
                count += 1
    return boxes[:count].copy()


@njit(cache=True)
def _tight(boxes, lower, upper):
    """Tight corners (N, 3) in voxel units, x, y, z."""
    n = len(boxes)
    low, high = np.empty((n, 3)), np.empty((n, 3))
    for b in range(n):
        low[b], high[b] = 1e9, -1e9
        for i in range(boxes[b, 0], boxes[b, 1] + 1):
            for j in range(boxes[b, 2], boxes[b, 3] + 1):
                for k in range(boxes[b, 4], boxes[b, 5] + 1):
                    base = (j, i, k)
                    for a in range(3):
                        low[b, a] = min(low[b, a], base[a] + lower[i, j, k, a] / STEPS)
                        high[b, a] = max(high[b, a], base[a] + upper[i, j, k, a] / STEPS)
    return low, high
