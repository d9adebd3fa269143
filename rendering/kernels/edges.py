"""Anti-aliasing: which pixels need more rays, and the mean of a pixel's rays."""

import numpy as np

from ...formats.core.arrays import F32, I32, U8, Mask
from ...formats.process.kernel import inlined, kernel
from .data import UNCOUNTED

U0, U1, U2 = np.uint64(0), np.uint64(1), np.uint64(2)  # indices that need no check for negatives


@inlined()
def _contrast(rgb: U8, i: np.uint64, j: np.uint64) -> np.int32:
    # Bytes are unsigned: their bare difference would wrap around.
    red = abs(np.int32(rgb[i, U0]) - np.int32(rgb[j, U0]))
    green = abs(np.int32(rgb[i, U1]) - np.int32(rgb[j, U1]))
    blue = abs(np.int32(rgb[i, U2]) - np.int32(rgb[j, U2]))
    return max(red, green, blue)


@kernel(3, **UNCOUNTED)
def find_edges(
    rgb: U8,
    depth: F32,
    surface: I32,
    prim: I32,
    width: int,
    height: int,
    relative_bend: float,
    min_contrast: int,
    marked: Mask,
) -> None:
    """Mark the pixels that lie on a visible geometric edge.

    An edge is where neighbours differ in colour and lie on different surfaces, or where inverse
    depth bends: on a plane it is linear in the image, so that its second difference is zero at
    any viewing angle.

    Args:
        rgb: (N, 3) uint8 sRGB of the pixels' centres.
        depth: (N,) planar depth, 0 = nothing.
        surface: (N,) id of what was hit (material, robot, nothing).
        prim: (N,) triangle that was hit, −1 = not known; there is no edge inside one.
        width: image width [px].
        height: image height [px].
        relative_bend: second difference of inverse depth, relative to it, that counts as a bend.
        min_contrast: smallest difference in sRGB bytes that counts as visible.
        marked: (N,) set to True at edges.
    """
    for direction in range(2):
        step = U1 if direction == 0 else np.uint64(width)
        columns = width - 1 if direction == 0 else width
        rows = height if direction == 0 else height - 1
        for row in range(rows):
            for column in range(columns):
                i = np.uint64(row * width + column)
                j = i + step
                in_scene = surface[i] >= 0 and surface[j] >= 0
                if in_scene and prim[i] == prim[j] and prim[i] >= 0:
                    continue
                if _contrast(rgb, i, j) < min_contrast:
                    continue
                edge = surface[i] != surface[j]
                if not edge and depth[i] > 0.0 and depth[j] > 0.0:
                    here, there = 1.0 / depth[i], 1.0 / depth[j]
                    before = i - step
                    after = j + step
                    has_before = column > 0 if direction == 0 else row > 0
                    has_after = column + 2 < width if direction == 0 else row + 2 < height
                    if has_before and depth[before] > 0.0:
                        bend = 1.0 / depth[before] - 2.0 * here + there
                        edge = abs(bend) > relative_bend * here
                    if not edge and has_after and depth[after] > 0.0:
                        bend = here - 2.0 * there + 1.0 / depth[after]
                        edge = abs(bend) > relative_bend * there
                if edge:
                    marked[i] = True
                    marked[j] = True


@kernel(3, **UNCOUNTED)
def in_order(order: I32, marked: Mask, out: I32) -> int:
    """Write the marked pixels to `out` in the order of `order`, which has −1 for none.

    Returns:
        How many there are.
    """
    count = 0
    for k in range(order.shape[0]):
        i = order[k]
        if i >= 0 and marked[i]:
            out[count] = i
            count += 1
    return count


@kernel(3)
def add_samples(samples: F32, count: int, pixels: I32, color: F32) -> F32:
    """Return the mean (K, 3) of each pixel's own colour in `color` (N, 3) and its `count` samples.

    `samples` is (K · count, 3), `pixels` (K,).
    """
    out = np.empty((pixels.shape[0], 3), dtype=np.float32)
    for i in range(pixels.shape[0]):
        for k in range(3):
            total = color[pixels[i], k]
            for s in range(count):
                total += samples[i * count + s, k]
            out[i, k] = total / np.float32(count + 1)
    return out
