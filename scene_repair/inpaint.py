"""Continuing a floor's pattern into holes by copying shifted floor that fits at the rim.

A hole is filled piece by piece. For each piece the shift is sought at which floor elsewhere agrees
best with what surrounds the piece (masked sum of squared differences for all shifts at once, by
FFT at half resolution, then refined), which keeps planks and tiles in phase; the seam's remaining
difference is spread smoothly over the piece. In the spirit of patch-based completion (Efros and
Freeman 2001; He and Sun 2012).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from .maps import Mask, Window, distance_to, grow, grown_window, nearest_in

Image32 = NDArray[np.float32]

# Pieces of this size, judged by a ring of this width around them, from a search this far around;
# even numbers, because the search runs at half resolution.
PIECE_PX = 48
RING_PX = 8
SEARCH_PX = 200
# The seam's difference is spread inwards by Gaussian means of growing width and falling weight,
# and beyond their reach by its mean.
SEAM_SPREAD = ((2.0, 1.0), (6.0, 0.1))
SEAM_MEAN_WEIGHT = 1e-3
LUMINANCE = np.array([0.299, 0.587, 0.114], dtype=np.float32)


def inpaint(image: Image32, known: Mask, wanted: Mask) -> Image32:
    """Colours for all `wanted` pixels.

    Args:
        image: (H, W, 3) colours in 0–1; only `known` pixels count.
        known: (H, W) bool, at least one.
        wanted: (H, W) bool pixels to fill; known ones stay.

    Returns:
        A copy with the wanted pixels filled; pixels in neither mask hold anything.
    """
    result = np.where(known[..., None], image, np.float32(0.0))
    todo = wanted & ~known
    if not todo.any():
        return result
    colors = image[known]
    if np.ptp(colors, axis=0).max() < 1e-3:
        result[todo] = colors[0]
        return result
    bright = result @ LUMINANCE
    filled = known.copy()
    # From the rim inwards, so that a piece always touches what is known already.
    depth = distance_to(known)
    rows, columns = np.nonzero(todo)
    order = np.argsort(depth[rows, columns], kind="stable")
    for i, j in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if todo[i, j]:
            window = _around((i, j), PIECE_PX // 2, todo.shape)
            _fill_piece(result, bright, filled, known, todo, window)
            bright[window] = result[window] @ LUMINANCE
            filled[window] |= todo[window]
            todo[window] = False
    return result


def _around(center: tuple[int, int], reach: int, shape: tuple[int, ...]) -> Window:
    i, j = center
    return (
        slice(max(i - reach, 0), min(i + reach, shape[0])),
        slice(max(j - reach, 0), min(j + reach, shape[1])),
    )


def _fill_piece(
    result: Image32, bright: Image32, filled: Mask, source: Mask, todo: Mask, window: Window
) -> None:
    """Write the pixels of one piece, those of `todo` in `window`, into `result`."""
    outer = grown_window(window, RING_PX, todo.shape)
    hole = np.zeros_like(todo[outer])
    inner = tuple(
        slice(w.start - o.start, w.stop - o.start) for w, o in zip(window, outer, strict=True)
    )
    hole[inner] = todo[window]
    ring = grow(hole, RING_PX) & filled[outer]
    middle = ((window[0].start + window[0].stop) // 2, (window[1].start + window[1].stop) // 2)
    search = _around(middle, SEARCH_PX, todo.shape)
    place = _best_place(bright[search], source[search], bright[outer], ring, hole)
    target = result[outer]
    if place is None:
        _copy_nearest(target, filled[outer], hole)
        return
    i, j = search[0].start + place[0], search[1].start + place[1]
    donor = result[i : i + hole.shape[0], j : j + hole.shape[1]]
    seam = np.where(ring[..., None], target - donor, np.float32(0.0))
    mixed = np.clip(donor + _spread(seam, ring), 0.0, 1.0)
    target[hole] = mixed[hole]


def _best_place(
    area: Image32, source: Mask, template: Image32, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Where in `area` the ring fits best and all of the hole is known floor; None if nowhere."""
    if any(a < t + 2 for a, t in zip(area.shape, template.shape, strict=True)):
        return None
    rough = _rough_place(
        area[::2, ::2], source[::2, ::2], template[::2, ::2], ring[::2, ::2], hole[::2, ::2]
    )
    if rough is None:
        return None
    height, width = hole.shape
    best, best_cost = None, np.inf
    for i in range(max(2 * rough[0] - 2, 0), min(2 * rough[0] + 3, area.shape[0] - height + 1)):
        for j in range(max(2 * rough[1] - 2, 0), min(2 * rough[1] + 3, area.shape[1] - width + 1)):
            known = source[i : i + height, j : j + width]
            # Half resolution may have missed single unknown pixels; few of them do no harm.
            if np.count_nonzero(hole & ~known) > 0.01 * np.count_nonzero(hole):
                continue
            both = ring & known
            difference = (area[i : i + height, j : j + width] - template)[both]
            cost = float(np.mean(difference**2)) if len(difference) else np.inf
            if best is None or cost < best_cost:
                best, best_cost = (i, j), cost
    return best


def _rough_place(
    area: Image32, source: Mask, template: Image32, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Best shift by correlations of masked images."""
    rows = area.shape[0] - ring.shape[0] + 1
    columns = area.shape[1] - ring.shape[1] + 1
    shape = tuple(fft.next_fast_len(n, real=True) for n in area.shape)

    def transform(a: Any) -> Any:
        return fft.rfft2(a.astype(np.float32), shape)

    def back(spectrum: Any) -> Image32:
        return np.asarray(fft.irfft2(spectrum, shape), dtype=np.float32)[:rows, :columns]

    available = source.astype(np.float32)
    weight = ring.astype(np.float32)
    seen = area * available
    wanted = template * weight
    f_available, f_weight = transform(available), np.conj(transform(weight))
    missing = hole.sum() - back(f_available * np.conj(transform(hole.astype(np.float32))))
    allowed = missing < 0.5
    if not allowed.any():
        return None
    overlap = back(f_available * f_weight)
    # Σ ring · known · (area − template)², for every shift at once.
    cost = back(
        transform(seen * seen) * f_weight
        - 2.0 * transform(seen) * np.conj(transform(wanted))
        + f_available * np.conj(transform(wanted * wanted))
    )
    allowed &= overlap >= min(0.5 * float(weight.sum()), float(overlap[allowed].max()))
    mean = np.where(allowed, cost / np.maximum(overlap, 1.0), np.inf)
    top, left = np.unravel_index(int(np.argmin(mean)), mean.shape)
    return int(top), int(left)


def _spread(seam: Image32, ring: Mask) -> Image32:
    """Continue the seam's difference smoothly from the ring over the piece."""
    mean = seam[ring].mean(axis=0) if ring.any() else np.zeros(3, dtype=np.float32)
    weight = np.full(ring.shape, SEAM_MEAN_WEIGHT, dtype=np.float32)
    total = np.tile(mean * np.float32(SEAM_MEAN_WEIGHT), (*ring.shape, 1))
    for sigma, strength in SEAM_SPREAD:
        near = ndimage.gaussian_filter(ring.astype(np.float32), sigma, truncate=3.0)
        weight += strength * near
        total += strength * ndimage.gaussian_filter(seam, (sigma, sigma, 0), truncate=3.0)
    return total / weight[..., None]


def _copy_nearest(target: Image32, filled: Mask, hole: Mask) -> None:
    """Nearest known colour: the last resort where no floor is large enough to copy from."""
    if filled.any():
        nearest = nearest_in(filled)
        i, j = np.nonzero(hole)
        target[i, j] = target[nearest[0][i, j], nearest[1][i, j]]
