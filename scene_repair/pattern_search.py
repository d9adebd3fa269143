"""Where in a picture something fits: masked template matching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from .maps import Mask, Window

Image32 = NDArray[np.float32]

# All places are tried at this fraction of the resolution, the best one's surroundings at full.
COARSE = 4
# Of what is copied this share may be unknown: single pixels that low resolution missed.
UNKNOWN_SHARE = 0.01
# The template must overlap known picture by this share of it.
OVERLAP = 0.5


@dataclass(frozen=True)
class Stock:
    """A picture to copy from, at full and at low resolution.

    Attributes:
        picture: (H, W).
        source: (H, W) where it may be copied from.
        share: (H // COARSE, W // COARSE) part of each block that may be copied.
        mean: mean of that part.
    """

    picture: Image32
    source: Mask
    share: Image32
    mean: Image32

    @staticmethod
    def of(picture: Image32, source: Mask) -> Stock:
        """Prepare a picture."""
        return Stock(picture, source, *reduced(source, picture))


def best_place(
    stock: Stock, search: Window, template: Image32, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Where the ring of the template fits best and all of the hole may be copied.

    Args:
        stock: what to copy from.
        search: the window of it that is searched.
        template: (h, w) picture around the hole.
        ring: (h, w) where it is compared.
        hole: (h, w) what is to be copied.

    Returns:
        Row and column in the stock of the template's corner; None if it fits nowhere.
    """
    place = _rough_place(stock, search, template, ring, hole)
    if place is None:
        return None
    ring_at, hole_at = np.nonzero(ring), np.nonzero(hole)
    wanted = template[ring_at]

    def cost(i: int, j: int) -> float:
        """Mean squared difference in the ring; inf where the hole could not be copied."""
        limit = stock.source.shape
        if i < 0 or j < 0 or i + hole.shape[0] > limit[0] or j + hole.shape[1] > limit[1]:
            return float("inf")
        known = stock.source[hole_at[0] + i, hole_at[1] + j]
        if np.count_nonzero(known) < (1 - UNKNOWN_SHARE) * len(known):
            return float("inf")
        both = stock.source[ring_at[0] + i, ring_at[1] + j]
        difference = (stock.picture[ring_at[0] + i, ring_at[1] + j] - wanted)[both]
        return float(np.mean(difference**2)) if len(difference) else 0.0

    i, j = place
    for step, reach in ((2, 4), (1, 1)):
        offsets = range(-reach, reach + 1, step)
        near = [(i + di, j + dj) for di in offsets for dj in offsets]
        costs = [cost(*p) for p in near]
        k = int(np.argmin(costs))
        if not np.isfinite(costs[k]):
            return None
        i, j = near[k]
    return i, j


def _rough_place(
    stock: Stock, search: Window, template: Image32, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Best shift by correlations of masked images at low resolution."""
    rows, columns = (slice(w.start // COARSE, w.stop // COARSE) for w in search)
    available, seen = stock.share[rows, columns], stock.mean[rows, columns]
    if any(n < COARSE for n in hole.shape):
        return None
    weight, wanted = reduced(ring, template)
    inside = blocks(hole.astype(np.float32))
    height = available.shape[0] - weight.shape[0] + 1
    width = available.shape[1] - weight.shape[1] + 1
    if height < 1 or width < 1:
        return None
    shape = tuple(fft.next_fast_len(n, real=True) for n in available.shape)

    def transform(a: Image32) -> Any:
        return fft.rfft2(a, shape)

    def back(spectrum: Any) -> Image32:
        return np.asarray(fft.irfft2(spectrum, shape), dtype=np.float32)[:height, :width]

    f_available, f_weight = transform(available), np.conj(transform(weight))
    missing = inside.sum() - back(f_available * np.conj(transform(inside)))
    allowed = missing < UNKNOWN_SHARE * inside.sum() + 1e-3
    if not allowed.any():
        return None
    overlap = back(f_available * f_weight)
    # Σ ring · known · (picture − template)², for every shift at once.
    cost = back(
        transform(available * seen * seen) * f_weight
        - 2.0 * transform(available * seen) * np.conj(transform(weight * wanted))
        + f_available * np.conj(transform(weight * wanted * wanted))
    )
    allowed &= overlap >= min(OVERLAP * float(weight.sum()), float(overlap[allowed].max()))
    mean = np.where(allowed, cost / np.maximum(overlap, 1.0), np.inf)
    top, left = np.unravel_index(int(np.argmin(mean)), mean.shape)
    return COARSE * (rows.start + int(top)), COARSE * (columns.start + int(left))


def reduced(mask: Mask, image: Image32) -> tuple[Image32, Image32]:
    """Part of each block that the mask covers, and the image's mean over it (H', W'[, 3])."""
    share = blocks(mask.astype(np.float32))
    known = mask if image.ndim == 2 else mask[..., None]
    total = blocks(np.where(known, image, np.float32(0.0)))
    part = np.maximum(share, np.float32(1e-6))
    return share, np.asarray(total / (part if image.ndim == 2 else part[..., None]), np.float32)


def blocks(image: Image32) -> Image32:
    """Means over blocks of `COARSE` pixels; what is left over at the end is not seen."""
    rows, columns = image.shape[0] // COARSE, image.shape[1] // COARSE
    cut = np.ascontiguousarray(image[: rows * COARSE, : columns * COARSE], dtype=np.float32)
    if not rows or not columns:
        return np.zeros((rows, columns, *image.shape[2:]), dtype=np.float32)
    return np.asarray(cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
