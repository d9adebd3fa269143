"""Continue a floor's pattern into holes by copying shifted floor that fits at the rim.

A picture of a floor is taken apart into light (its colours, smoothed widely) and pattern (what is
left). Light is continued smoothly into a hole. The pattern is filled in piece by piece: for each
piece the shift is found at which the pattern elsewhere agrees best with what surrounds the piece
(masked sum of squared differences for all shifts at once, by FFT at low resolution, then refined),
which keeps planks and tiles in phase. In the spirit of patch-based completion (Efros and Freeman
2001; He and Sun 2012).

Patterns are copied from plain floor: not from rugs, sunlit patches, and the floor's own rim, which
scans paint with what stands there; unless a hole's surroundings are not plain themselves.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from ...formats.core.arrays import F32, Mask
from ..grid.morphology import Window, grow, grown_window, label
from .illumination import blurred, split_light
from .pattern_search import COARSE, Stock, best_place, reduced

# Pieces of this size, judged by a ring of this width around them, from a search this far around.
PIECE_M, RING_M, SEARCH_M = 0.48, 0.08, 2.0
# The next pending pixel is looked for among so many at once.
LOOKED_AT = 4096
# Where no floor so large is known smaller pieces are tried; they are searched for nearby.
HALVINGS = 3
SEARCH_PER_SIZE, LEAST_SEARCH_M = 8.0, 0.5
# The scan's rim is taken for smeared this far.
SMEARED_M = 0.015
# Floor is plain if its colour, averaged this widely, is near to most of the floor's: within this
# many times the deviation that most of it keeps, or within a slight change of light.
PLAIN_SIGMA_M, PLAIN_SHARE, PLAIN_FACTOR, PLAIN_LEAST = 0.06, 0.6, 2.5, 0.12
# A piece is surrounded by something else than plain floor from this share of its ring on, which
# then is continued, but not far: what lies deep under furniture is plain floor.
SPECIAL_SHARE, SPECIAL_DEPTH_M = 0.3, 0.2
# The seam's difference fades over this distance, at most so much of it.
SEAM_SIGMA_M, SEAM_LIMIT, SEAM_FADE = 0.02, 0.3, 0.05


@dataclass
class _Canvas:
    """The floor's pattern while it is being filled, all (H, W) or (H, W, 3).

    `filled` is what has been filled already; `deep` holes reach far away from scanned floor;
    `sound` can be copied: the scanned floor without its
    smeared rim; `plain` is the part of it that looks as most of it does.
    """

    pattern: F32
    bright: F32
    filled: Mask
    todo: Mask
    deep: Mask
    sound: Stock
    plain: Stock


def inpaint(image: F32, valid: Mask, pending: Mask, texel_m: float) -> F32:
    """Return the image (H, W, 3) in 0–1 with `pending` (H, W) pixels filled that are no `valid`.

    At least one pixel is valid; those in neither mask hold anything. `texel_m` is a pixel's side.
    """
    result = image.copy()
    todo = pending & ~valid
    if not todo.any():
        return result
    colors = image[valid]
    if _same(colors[::97]) and _same(colors):
        result[todo] = colors[0]
        return result
    # Known pixels away from the rim, or all if there are no others.
    inner = ~grow(~valid, max(1, round(SMEARED_M / texel_m)))
    sound = inner if inner.any() else valid
    plain = _plain(image, sound, texel_m)
    split = split_light(image, valid, plain, texel_m)
    bright = _bright(split.pattern)
    depth = np.asarray(
        cv2.distanceTransform((~valid).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    )
    parts, count = label(todo)
    deep = np.zeros(count + 1, dtype=bool)
    deep[np.unique(parts[todo & (depth * texel_m > SPECIAL_DEPTH_M)])] = True
    scanned = bright.copy()
    canvas = _Canvas(
        split.pattern,
        bright,
        np.zeros_like(todo),
        todo.copy(),
        deep[parts],
        Stock.of(scanned, sound),
        Stock.of(scanned, plain),
    )
    # From the rim inwards, so that a piece always touches what is known already.
    rows, columns = np.nonzero(todo)
    order = np.argsort(depth[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    reach = round(PIECE_M / texel_m / 2)
    first = 0
    while first < len(rows):
        part = slice(first, first + LOOKED_AT)
        left = np.flatnonzero(canvas.todo[rows[part], columns[part]])
        if len(left):
            first += int(left[0])
            _fill_piece(canvas, (int(rows[first]), int(columns[first])), reach, texel_m)
            first += 1
        else:
            first += LOOKED_AT
    result[todo] = split.joined(canvas.pattern, todo)
    return result


def _same(colors: F32) -> bool:
    return bool(np.ptp(colors, axis=0).max() < 1e-3)


def _bright(pattern: F32) -> F32:
    """Return the mean (H, W) of the channels."""
    return np.asarray(cv2.transform(pattern, np.full((1, 3), 1 / 3)), dtype=np.float32)


def _plain(image: F32, sound: Mask, texel_m: float) -> Mask:
    """Return where the floor has its most common appearance."""
    share, mean = reduced(sound, image)
    sigma = PLAIN_SIGMA_M / texel_m / COARSE
    weight = blurred(share, sigma)
    mean = blurred(mean * share[..., None], sigma) / np.maximum(weight, 1e-6)[..., None]
    tone = np.log(np.maximum(mean, 0.02))
    seen = share > 0.5
    if not seen.any():
        return sound
    apart = np.abs(tone - np.median(tone[seen], axis=0)).max(axis=2)
    limit = max(PLAIN_LEAST, PLAIN_FACTOR * float(np.quantile(apart[seen], PLAIN_SHARE)))
    other = grow(seen & (apart > limit), max(1, round(sigma)))
    other = np.repeat(np.repeat(other, COARSE, axis=0), COARSE, axis=1)
    plain = sound.copy()
    plain[: other.shape[0], : other.shape[1]] &= ~other
    return plain if np.count_nonzero(plain) > 0.05 * np.count_nonzero(sound) else sound


def _around(center: tuple[int, int], reach: int, shape: tuple[int, ...]) -> Window:
    i, j = center
    return (
        slice(max(i - reach, 0), min(i + reach, shape[0])),
        slice(max(j - reach, 0), min(j + reach, shape[1])),
    )


def _fill_piece(canvas: _Canvas, center: tuple[int, int], reach: int, texel_m: float) -> None:
    """Fill the pattern around one pending pixel."""
    for _ in range(HALVINGS):
        window = _around(center, max(reach, 2), canvas.todo.shape)
        if _copy_from_elsewhere(canvas, _tight(canvas.todo, window), texel_m):
            return
        reach //= 2
    # Nothing to copy from: light alone.
    window = _around(center, max(reach, 2), canvas.todo.shape)
    canvas.pattern[window][canvas.todo[window]] = 0.0
    _finish(canvas, window)


def _tight(mask: Mask, window: Window) -> Window:
    """Return the part of a window in which the mask is true anywhere."""
    rows = np.flatnonzero(mask[window].any(axis=1))
    columns = np.flatnonzero(mask[window].any(axis=0))
    top, left = window[0].start, window[1].start
    return (
        slice(top + int(rows[0]), top + int(rows[-1]) + 1),
        slice(left + int(columns[0]), left + int(columns[-1]) + 1),
    )


def _copy_from_elsewhere(canvas: _Canvas, window: Window, texel_m: float) -> bool:
    """Fill the pending pixels in `window` from a matching place; return whether it succeeded."""
    ring_px = round(RING_M / texel_m)
    outer = grown_window(window, ring_px, canvas.todo.shape)
    inner = tuple(
        slice(w.start - o.start, w.stop - o.start) for w, o in zip(window, outer, strict=True)
    )
    hole = np.zeros_like(canvas.todo[outer])
    hole[inner] = canvas.todo[window]
    near = grow(hole, ring_px)
    scanned = near & canvas.sound.source[outer]
    plain = scanned & canvas.plain.source[outer]
    other = np.count_nonzero(scanned & ~plain)
    special = other > SPECIAL_SHARE * max(np.count_nonzero(scanned), 1)
    special &= not (hole & canvas.deep[outer]).any()
    stock = canvas.sound if special else canvas.plain
    ring = (scanned if special else plain) | (near & canvas.filled[outer])
    size_m = max(hole.shape) * texel_m - 2 * RING_M
    search = _search_window(window, size_m, texel_m, canvas.todo.shape)
    place = best_place(stock, search, canvas.bright[outer], ring=ring, hole=hole)
    if place is None:
        return False
    i, j = place
    donor = canvas.pattern[i : i + hole.shape[0], j : j + hole.shape[1]]
    target = canvas.pattern[outer]
    valid = stock.source[i : i + hole.shape[0], j : j + hole.shape[1]]
    seam = np.where((ring & valid)[..., None], target - donor, np.float32(0.0))
    target[hole] = (donor + _spread(seam, ring & valid, SEAM_SIGMA_M / texel_m))[hole]
    _finish(canvas, window)
    return True


def _search_window(window: Window, size_m: float, texel_m: float, shape: tuple[int, ...]) -> Window:
    """Return the search window of `window`; neighbouring pieces share one."""
    reach_m = LEAST_SEARCH_M
    while reach_m < min(SEARCH_PER_SIZE * size_m, SEARCH_M):
        reach_m *= 1.6
    reach = round(reach_m / texel_m)
    raster = max(reach // 4, 1)
    i, j = (round((w.start + w.stop) / 2 / raster) * raster for w in window)
    return _around((i, j), reach, shape)


def _finish(canvas: _Canvas, window: Window) -> None:
    canvas.bright[window] = _bright(canvas.pattern[window])
    canvas.filled[window] |= canvas.todo[window]
    canvas.todo[window] = False


def _spread(seam: F32, ring: Mask, sigma: float) -> F32:
    """Continue the difference at the seam from the ring into the piece, fading out."""
    limited = np.clip(seam, -SEAM_LIMIT, SEAM_LIMIT)
    side = 2 * round(3 * sigma) + 1

    def blur(a: F32) -> F32:
        smooth = cv2.GaussianBlur(a, (side, side), sigma, borderType=cv2.BORDER_REFLECT)
        return np.asarray(smooth, dtype=np.float32)

    weight = blur(ring.astype(np.float32))
    return np.asarray(blur(limited) / (weight + SEAM_FADE)[..., None], dtype=np.float32)
