"""Texture filtering over a pixel's footprint, to be inlined into kernels."""

import numpy as np

from ...formats.process.kernel import inlined
from .data import FAST, TexturePack
from .vectors import filter_texels, prefetch

f32 = np.float32

MAX_TAPS = f32(6.0)
# Between mip levels, and between their texels, filtering blurs by more than the footprint. Levels
# finer by this come closest to the mean over the footprint (against 16 samples a pixel: 0.25 is
# blurrier, and less like it).
SHARPER = f32(0.5)
EXPONENT_BIAS = np.int32(127 << 23)
HALF_PER_OCTAVE = f32(0.5 / (1 << 23))
U0, U1 = np.uint64(0), np.uint64(1)  # indices that need no check for negative ones
PER_SQUARE = f32(1.0 / 1023.0**2)  # texels hold 10-bit square roots


@inlined(error_model="numpy", fastmath=FAST)
def footprint(pack: TexturePack, texture, du_dx, dv_dx, du_dy, dv_dy):
    """Return how to filter a texture over a pixel's footprint.

    The footprint is the parallelogram of the two derivatives. Taps lie along its longer side, the
    mip level follows its shorter one (as graphics hardware does, after McCormack et al., "Feline",
    1999), so that floors seen at a grazing angle stay sharp across and do not shimmer along.

    Args:
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
        lod = max(f32(0.0), min(lod - SHARPER, f32(pack.levels[texture] - 1)))
    return taps, lod, step_u, step_v


@inlined(error_model="numpy", fastmath=FAST)
def sample_texture(pack: TexturePack, texels, texture, u, v, taps, lod, step_u, step_v):
    """Return the colour of a texture over a footprint: red, green, blue in linear light.

    Args:
        texels: address of their texels.
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
    next_level = level
    if fraction > f32(0.0):
        next_level = level + np.int32(1)
    share = f32(1.0) / f32(taps)
    step_u *= share
    step_v *= share
    first = f32(0.5) * (f32(taps) - f32(1.0))
    t, a, b = np.uint64(texture), np.uint64(level), np.uint64(next_level)
    return filter_texels(
        texels,
        (np.int32(pack.offset[t, a]), np.int32(pack.offset[t, b])),
        (
            pack.size_px[t, a, U0], pack.size_px[t, a, U1],
            pack.size_px[t, b, U0], pack.size_px[t, b, U1],
        ),
        (u - first * step_u, v - first * step_v),
        (step_u, step_v),
        taps,
        share * PER_SQUARE,
        fraction,
    )  # fmt: skip


@inlined(error_model="numpy", fastmath=FAST)
def prefetch_texels(pack: TexturePack, texels, texture, u, v, taps, lod, step_u, step_v):
    """Bring the texels of the first tap of `sample_texture` nearer."""
    level = np.uint64(lod)
    share = f32(0.5) - f32(0.5) / f32(taps)
    u -= share * step_u
    v -= share * step_v
    u -= np.floor(u)
    v -= np.floor(v)
    for _ in range(2):
        width = pack.size_px[texture, level, U0]
        height = pack.size_px[texture, level, U1]
        column = np.int32(max(u * f32(width) - f32(0.5), f32(0.0)))
        row = np.int32(max((f32(1.0) - v) * f32(height) - f32(0.5), f32(0.0)))
        first = np.int64(pack.offset[texture, level]) + row * (width + 1) + column
        prefetch(np.uint64(texels + 4 * first))
        prefetch(np.uint64(texels + 4 * (first + width + 1)))
        if f32(level) == lod:
            break
        level += U1
