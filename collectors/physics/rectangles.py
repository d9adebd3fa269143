"""Cover cells of a map with few rectangles."""

import numpy as np

from ...formats.core.arrays import I64, Floats, Mask
from ...formats.process.kernel import kernel


def rectangles(cells: Mask, height_m: Floats, tolerance_m: float) -> I64:
    """Return rectangles (N, 4) that cover all marked cells once and no other.

    Each is (first row, first column, end row, end column). Greedy, row by row: from the first cell
    left a rectangle grows to the right, then down, over heights (rows, columns) [m] that differ
    from the first cell's by at most `tolerance_m`.
    """
    height = np.asarray(height_m, dtype=np.float64)
    result = np.empty((int(cells.sum()), 4), dtype=np.int64)
    return result[: _grow(cells.copy(), height, tolerance_m, result)]


@kernel()
def _grow(left, height, tolerance, result):
    """Fill `result` and return the number of rectangles; `left` is used up."""
    count = 0
    for i in range(left.shape[0]):
        for j in range(left.shape[1]):
            if not left[i, j]:
                continue
            z = height[i, j]
            end = j
            while end < left.shape[1] and left[i, end] and abs(height[i, end] - z) <= tolerance:
                end += 1
            bottom, whole = i, True
            while whole:
                for c in range(j, end):
                    left[bottom, c] = False
                bottom += 1
                whole = bottom < left.shape[0]
                c = j
                while whole and c < end:
                    whole = left[bottom, c] and abs(height[bottom, c] - z) <= tolerance
                    c += 1
            result[count, 0], result[count, 1] = i, j
            result[count, 2], result[count, 3] = bottom, end
            count += 1
    return count
