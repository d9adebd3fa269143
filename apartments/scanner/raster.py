"""Rasterise triangles to the texels of a page."""

import numpy as np

from ...formats.core.arrays import F32, I32, Array
from ...formats.process.kernel import kernel

# Texels up to this far outside a triangle are painted too, so that filtering finds colour there.
_REACH = 1.8


def rasterize(corner: Array, page_size: tuple[int, int]) -> tuple[I32, F32]:
    """Paint triangles with corners (F, 3, 2) [texels, y down] on a page (width, height).

    Return face (height, width) int32, −1 = empty, and bary (height, width, 2) float32, the weights
    of the second and third corner, beyond 0…1 in the margin around charts.
    """
    width, height = page_size
    face = np.full((height, width), -1, dtype=np.int32)
    bary = np.zeros((height, width, 2), dtype=np.float32)
    _paint(corner, face, bary, 0.0)
    _paint(corner, face, bary, _REACH)
    return face, bary


@kernel()
def _paint(corner, face, bary, reach):
    height, width = face.shape
    for f in range(corner.shape[0]):
        ax, ay = corner[f, 0, 0], corner[f, 0, 1]
        e1x, e1y = corner[f, 1, 0] - ax, corner[f, 1, 1] - ay
        e2x, e2y = corner[f, 2, 0] - ax, corner[f, 2, 1] - ay
        twice = e1x * e2y - e1y * e2x
        if abs(twice) < 1e-9:
            continue
        # Allowed overshoot of each weight: reach divided by the height over that edge.
        over1 = reach * np.sqrt(e2x * e2x + e2y * e2y) / abs(twice) + 1e-6
        over2 = reach * np.sqrt(e1x * e1x + e1y * e1y) / abs(twice) + 1e-6
        dx, dy = e2x - e1x, e2y - e1y
        over0 = reach * np.sqrt(dx * dx + dy * dy) / abs(twice) + 1e-6
        x0 = max(int(np.floor(ax + min(0.0, e1x, e2x) - reach)), 0)
        x1 = min(int(np.ceil(ax + max(0.0, e1x, e2x) + reach)), width)
        y0 = max(int(np.floor(ay + min(0.0, e1y, e2y) - reach)), 0)
        y1 = min(int(np.ceil(ay + max(0.0, e1y, e2y) + reach)), height)
        for y in range(y0, y1):
            for x in range(x0, x1):
                if face[y, x] >= 0:
                    continue
                px, py = x + 0.5 - ax, y + 0.5 - ay
                b = (px * e2y - py * e2x) / twice
                c = (e1x * py - e1y * px) / twice
                if b >= -over1 and c >= -over2 and 1.0 - b - c >= -over0:
                    face[y, x] = f
                    # Far corners of the margin of slivers would extrapolate without bound.
                    bary[y, x, 0] = min(max(b, -1.0), 2.0)
                    bary[y, x, 1] = min(max(c, -1.0), 2.0)
