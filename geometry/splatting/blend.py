"""Kernels: sort projected Gaussians by depth, and blend them tile by tile, front to back."""

import math

import numpy as np

from ...formats.process.kernel import kernel
from .project import (
    BLUE,
    CONIC_XX,
    CONIC_XY,
    CONIC_YY,
    DEPTH,
    GREEN,
    HALF_X,
    HALF_Y,
    LIMIT,
    OPACITY,
    RED,
    SLOPE_X,
    SLOPE_Y,
    TILE,
    X,
    Y,
    any_unfinished,
)
from .scene import MIN_ALPHA

MAX_ALPHA = 0.99
# A pixel is finished before less than this share of light would get through.
MIN_LIGHT = 1e-4
# exp(−x) for x from 0 to `TABLE_END`, interpolated linearly: error below 1e-6.
TABLE_END, TABLE_STEPS = 5.6, 2048
TABLE = np.exp(-np.linspace(0, TABLE_END, TABLE_STEPS + 1)).astype(np.float32)
RADIX_BITS = 11
TILE_BITS = 4


@kernel(3)
def count_unfinished(light, columns, unfinished):
    """Write how many unfinished pixels lie above and to the left of each corner of a pixel.

    Args:
        light: (tiles, 256) see `blend_tiles`; positive where a pixel is not finished.
        columns: number of tiles in a row.
        unfinished: (height + 1, width + 1) int32: a summed-area table, so that the number in any
            rectangle follows from its four corners.
    """
    height, width = unfinished.shape[0] - 1, unfinished.shape[1] - 1
    for y in range(height):
        row = 0
        first = (y >> TILE_BITS) * columns
        line = (y & (TILE - 1)) << TILE_BITS
        for x in range(width):
            if light[first + (x >> TILE_BITS), line + (x & (TILE - 1))] > 0:
                row += 1
            unfinished[y + 1, x + 1] = unfinished[y, x + 1] + row


@kernel(3)
def split_by_depth(rows, waiting, count, limit, unfinished):
    """Return copies of the rows nearer than `limit` [m], by depth, and the number of other rows.

    The others are moved to the beginning of `rows`.

    Args:
        rows: (N, 15) see `COLUMNS`, of which `count` are used.
        waiting: number of rows that have waited since before the last tiles were blended; of these
            the ones that only touch finished pixels are dropped.
        unfinished: see `count_unfinished`.
    """
    near = np.empty(count, dtype=np.int32)
    far = np.empty(count, dtype=np.int32)
    n = m = 0
    for k in range(count):
        if k < waiting:
            x, y, hx, hy = rows[k, X], rows[k, Y], rows[k, HALF_X], rows[k, HALF_Y]
            if not any_unfinished(unfinished, x - hx, x + hx, y - hy, y + hy):
                continue
        if rows[k, DEPTH] < limit:
            near[n] = k
            n += 1
        else:
            far[m] = k
            m += 1
    keys = np.empty(n, dtype=np.float32)
    for k in range(n):
        keys[k] = rows[near[k], DEPTH]
    # The bits of positive floats have the order of the numbers.
    bits = keys.view(np.uint32)
    order = near[:n].copy()
    other, other_bits = np.empty_like(order), np.empty_like(bits)
    for shift in range(0, 32, RADIX_BITS):
        counts = np.zeros(1 << RADIX_BITS, dtype=np.int64)
        for k in range(n):
            counts[bits[k] >> np.uint32(shift) & np.uint32((1 << RADIX_BITS) - 1)] += 1
        if n and counts[bits[0] >> np.uint32(shift) & np.uint32((1 << RADIX_BITS) - 1)] == n:
            continue
        total = 0
        for digit in range(1 << RADIX_BITS):
            counts[digit], total = total, total + counts[digit]
        for k in range(n):
            digit = bits[k] >> np.uint32(shift) & np.uint32((1 << RADIX_BITS) - 1)
            other[counts[digit]], other_bits[counts[digit]] = order[k], bits[k]
            counts[digit] += 1
        order, other = other, order
        bits, other_bits = other_bits, bits
    # Copied, so that each tile reads its Gaussians from front to back of memory.
    sorted_rows = np.empty((n, rows.shape[1]), dtype=np.float32)
    for k in range(n):
        for i in range(rows.shape[1]):
            sorted_rows[k, i] = rows[order[k], i]
    for k in range(m):
        if far[k] != k:
            for i in range(rows.shape[1]):
                rows[k, i] = rows[far[k], i]
    return sorted_rows, m


@kernel(3)
def list_tiles(rows, alive):
    """Return the rows of each unfinished tile, in their order, and where the tile's list starts."""
    tile_rows, columns = alive.shape
    starts = np.zeros(alive.size + 1, dtype=np.int64)
    count = rows.shape[0]
    box = np.empty((count, 4), dtype=np.int16)
    across, down = np.float32(TILE * columns - 1), np.float32(TILE * tile_rows - 1)
    zero = np.float32(0)
    for g in range(count):
        x, y, hx, hy = rows[g, X], rows[g, Y], rows[g, HALF_X], rows[g, HALF_Y]
        left = int(max(x - hx, zero)) >> TILE_BITS
        top = int(max(y - hy, zero)) >> TILE_BITS
        right = int(min(x + hx, across)) >> TILE_BITS
        bottom = int(min(y + hy, down)) >> TILE_BITS
        box[g, 0], box[g, 1], box[g, 2], box[g, 3] = left, top, right, bottom
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                if alive[r, c] > 0:
                    starts[r * columns + c + 1] += 1
    for t in range(alive.size):
        starts[t + 1] += starts[t]
    at = starts[:-1].copy()
    listed = np.empty(starts[-1], dtype=np.int32)
    for g in range(count):
        for r in range(box[g, 1], box[g, 3] + 1):
            for c in range(box[g, 0], box[g, 2] + 1):
                if alive[r, c] > 0:
                    t = r * columns + c
                    listed[at[t]] = g
                    at[t] += 1
    return listed, starts


@kernel(3, fastmath={"nnan", "nsz", "arcp", "contract", "afn"}, error_model="numpy")
def blend_tiles(rows, lists, alive, size, image, table):
    """Blend lists of Gaussians into the tiles (Kerbl et al., 2023, equation 3).

    Args:
        rows: projected Gaussians, see `COLUMNS`.
        lists: those of each tile, and where each tile's list starts; see `list_tiles`.
        alive: (rows, columns) pixels of each tile that are not finished, updated.
        size: width and height [px], and the share of light below which a pixel is finished once
            another Gaussian is blended; 0 = only where the published formula stops.
        image: four arrays by tile and pixel. (tiles, 256) light that gets through so far, negative
            once finished, updated; (tiles, 256, 3) colour, updated; (tiles, 256) depth [m] of an
            opaque body that hides what is behind it; (tiles, 256, 3) sums of depth and of its
            square weighted by light, and the depth at which half of the light is gone, updated
            unless it has no rows.
        table: `TABLE`.
    """
    width, height, enough = size
    listed, starts = lists
    light, color, cover, depth = image
    columns = alive.shape[1]
    with_depth = depth.shape[0] > 0
    slope, last = table[1:] - table[:-1], np.uint32(TABLE_STEPS)
    per_step = np.float32(TABLE_STEPS / TABLE_END)
    half, one = np.float32(0.5), np.float32(1)
    least, most, dark = np.float32(MIN_ALPHA), np.float32(MAX_ALPHA), np.float32(MIN_LIGHT)
    for t in range(alive.size):
        left = alive[t // columns, t % columns]
        if left == 0:
            continue
        row = np.uint32(t)
        x_tile, y_tile = t % columns * TILE, t // columns * TILE
        x_end, y_end = min(x_tile + TILE, width) - 1, min(y_tile + TILE, height) - 1
        for i in range(starts[t], starts[t + 1]):
            g = listed[i]
            mx, my = rows[g, X], rows[g, Y]
            a, b, d = rows[g, CONIC_XX], rows[g, CONIC_XY], rows[g, CONIC_YY]
            o, limit, z = rows[g, OPACITY], rows[g, LIMIT], rows[g, DEPTH]
            red, green, blue = rows[g, RED], rows[g, GREEN], rows[g, BLUE]
            inverse, flat = one / a, a * d - b * b
            y0 = max(math.ceil(my - rows[g, HALF_Y]), y_tile)
            y1 = min(math.floor(my + rows[g, HALF_Y]), y_end)
            for y in range(y0, y1 + 1):
                dy = np.float32(y) - my
                # Where the row leaves the ellipse of the least visible opacity.
                inside = limit * a - flat * dy * dy
                if inside < 0:
                    continue
                span = math.sqrt(inside) * inverse
                middle = mx - b * dy * inverse
                x0 = max(math.ceil(middle - span), x_tile)
                x1 = min(math.floor(middle + span), x_end)
                base = (y - y_tile) * TILE - x_tile
                cdy, bdy = half * d * dy * dy, b * dy
                for x in range(x0, x1 + 1):
                    # Unsigned, so that no index is tested for counting from the end.
                    p = np.uint32(base + x)
                    through = light[row, p]
                    if through <= 0:
                        continue
                    if z > cover[row, p]:
                        light[row, p] = -through
                        left -= 1
                        continue
                    dx = np.float32(x) - mx
                    power = half * a * dx * dx + cdy + bdy * dx
                    step = max(power, np.float32(0)) * per_step
                    at = np.uint32(step)
                    if at >= last:
                        continue
                    alpha = o * (table[at] + (step - np.float32(at)) * slope[at])
                    if alpha < least:
                        continue
                    alpha = min(alpha, most)
                    after = through * (one - alpha)
                    if after < dark:
                        light[row, p] = -through
                        left -= 1
                        continue
                    weight = alpha * through
                    color[row, p, 0] += weight * red
                    color[row, p, 1] += weight * green
                    color[row, p, 2] += weight * blue
                    light[row, p] = after
                    if after < enough:
                        light[row, p] = -after
                        left -= 1
                    if with_depth:
                        at_pixel = z + rows[g, SLOPE_X] * dx + rows[g, SLOPE_Y] * dy
                        depth[row, p, 0] += weight * at_pixel
                        depth[row, p, 1] += weight * at_pixel * at_pixel
                        if through > half >= after:
                            depth[row, p, 2] = at_pixel
            if left == 0:
                break
        alive[t // columns, t % columns] = left
