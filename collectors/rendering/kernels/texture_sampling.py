"""Texture filtering over a pixel's footprint, to be inlined into kernels."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..scene.textures import TexturePack
from .embree_library import prefetch

f32 = np.float32

MAX_TAPS = f32(6.0)
EXPONENT_BIAS = np.int32(127 << 23)
HALF_PER_OCTAVE = f32(0.5 / (1 << 23))
PER_SQUARE = f32(1.0 / 1023.0**2)  # texels hold 10-bit square roots


@njit(inline="always", error_model="numpy")
def _square(texel: np.uint32, shift: int) -> np.float32:
    value = f32(np.int32((texel >> np.uint32(shift)) & np.uint32(1023)))
    return value * value


@njit(inline="always", error_model="numpy")
def bilinear(texels: NDArray[np.uint32], start, width, height, u, v):
    """Return the bilinear colour at (u, v) of one mip level, as sums of squared 10-bit roots.

    Args:
        texels: all texels.
        start: index of the level's first texel.
        width: of the level [px], int32.
        height: of the level [px], int32.
        u: texture coordinate to the right, float32, repeating.
        v: texture coordinate upwards, float32, repeating.
    """
    x = (u - np.floor(u)) * f32(width) - f32(0.5)
    y = (f32(1.0) - (v - np.floor(v))) * f32(height) - f32(0.5)  # v points up, rows go down
    left = np.floor(x)
    top = np.floor(y)
    fx = x - left
    fy = y - top
    x0 = np.int32(left)
    y0 = np.int32(top)
    x1 = x0 + np.int32(1)
    y1 = y0 + np.int32(1)
    if x0 < 0:
        x0 += width
    if y0 < 0:
        y0 += height
    if x1 >= width:
        x1 -= width
    if y1 >= height:
        y1 -= height
    row0 = start + np.int64(y0) * width
    row1 = start + np.int64(y1) * width
    a = texels[np.uint64(row0 + x0)]
    b = texels[np.uint64(row0 + x1)]
    c = texels[np.uint64(row1 + x0)]
    d = texels[np.uint64(row1 + x1)]
    wd = fx * fy
    wb = fx - wd
    wc = fy - wd
    wa = f32(1.0) - fx - wc
    return (
        wa * _square(a, 0) + wb * _square(b, 0) + wc * _square(c, 0) + wd * _square(d, 0),
        wa * _square(a, 10) + wb * _square(b, 10) + wc * _square(c, 10) + wd * _square(d, 10),
        wa * _square(a, 20) + wb * _square(b, 20) + wc * _square(c, 20) + wd * _square(d, 20),
    )


@njit(inline="always", error_model="numpy")
def footprint(pack: TexturePack, texture, du_dx, dv_dx, du_dy, dv_dy):
    """Return how to filter a texture over a pixel's footprint.

    The footprint is the parallelogram of the two derivatives. Taps lie along its longer side, the
    mip level follows its shorter one (as graphics hardware does, after McCormack et al., "Feline",
    1999), so that floors seen at a grazing angle stay sharp across and do not shimmer along.

    Args:
        pack: all textures.
        texture: index of the texture.
        du_dx: change of u per pixel to the right.
        dv_dx: change of v per pixel to the right.
        du_dy: change of u per pixel down.
        dv_dy: change of v per pixel down.

    Returns:
        Number of taps, mip level (with its fraction), and the longer side's change of u and v.
    """
    width = f32(pack.size_px[texture, 0, 0])
    height = f32(pack.size_px[texture, 0, 1])
    ax = du_dx * width
    bx = dv_dx * height
    ay = du_dy * width
    by = dv_dy * height
    step_u = du_dx
    step_v = dv_dx
    long_square = ax * ax + bx * bx
    short_square = ay * ay + by * by
    if short_square > long_square:
        step_u = du_dy
        step_v = dv_dy
        long_square, short_square = short_square, long_square
    taps = np.int32(1)
    lod = f32(0.0)
    if long_square > f32(1.0):
        # A sheared footprint is narrower than its shorter side: its area says how narrow.
        area = ax * by - ay * bx
        short_square = max(f32(1.0), min(short_square, area * area / long_square))
        ratio = np.sqrt(long_square / short_square)
        taps = np.int32(min(MAX_TAPS, max(f32(1.0), np.ceil(ratio - f32(0.5)))))
        per_tap = f32(1.0) / f32(taps)
        # log2 from the float's exponent and linearly between powers of two, as hardware does.
        bits = f32(max(short_square, long_square * per_tap * per_tap)).view(np.int32)
        lod = f32(bits - EXPONENT_BIAS) * HALF_PER_OCTAVE
        lod = min(lod, f32(pack.levels[texture] - 1))
    return taps, lod, step_u, step_v


@njit(inline="always", error_model="numpy")
def prefetch_texels(pack: TexturePack, texels, texture, lod, u, v):
    """Prefetch the texels around (u, v), which are read soon; `texels` is their address."""
    level = np.int32(lod)
    for _ in range(2):
        width = pack.size_px[texture, level, 0]
        height = pack.size_px[texture, level, 1]
        x = np.int64((u - np.floor(u)) * f32(width) - f32(0.5))
        y = np.int64((f32(1.0) - (v - np.floor(v))) * f32(height) - f32(0.5))
        at = texels + np.int64(4) * (pack.offset[texture, level] + y * width + x)
        prefetch(np.uintp(at))
        prefetch(np.uintp(at + np.int64(4) * width))
        if lod <= f32(level):
            break
        level += np.int32(1)


@njit(inline="always", error_model="numpy")
def sample_texture(pack: TexturePack, texture, u, v, taps, lod, step_u, step_v):
    """Return the colour of a texture over a footprint: red, green, blue in linear light.

    Args:
        pack: all textures.
        texture: index of the texture.
        u: texture coordinate to the right, float32.
        v: texture coordinate upwards, float32.
        taps: from `footprint`, as are the next.
        lod: mip level.
        step_u: change of u along the footprint.
        step_v: change of v along the footprint.
    """
    level = np.int32(lod)
    fraction = lod - f32(level)
    red = green = blue = f32(0.0)
    share = f32(1.0) / f32(taps)
    step_u *= share
    step_v *= share
    first = f32(0.5) * (f32(taps) - f32(1.0))
    u -= first * step_u
    v -= first * step_v
    for _ in range(taps):
        r, g, b = bilinear(
            pack.texels,
            pack.offset[texture, level],
            pack.size_px[texture, level, 0],
            pack.size_px[texture, level, 1],
            u,
            v,
        )
        if fraction > f32(0.0):
            r1, g1, b1 = bilinear(
                pack.texels,
                pack.offset[texture, level + 1],
                pack.size_px[texture, level + 1, 0],
                pack.size_px[texture, level + 1, 1],
                u,
                v,
            )
            r += fraction * (r1 - r)
            g += fraction * (g1 - g)
            b += fraction * (b1 - b)
        red += r
        green += g
        blue += b
        u += step_u
        v += step_v
    share *= PER_SQUARE
    return red * share, green * share, blue * share
