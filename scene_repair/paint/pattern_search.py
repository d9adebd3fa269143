"""Masked template matching."""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ...formats.core.arrays import F32, I64, Mask
from ..grid.morphology import Window

# All places are tried at this fraction of the resolution, the best one's surroundings at full.
COARSE = 4
# Of what is copied this share may be unknown: single pixels that low resolution missed.
UNKNOWN_SHARE = 0.01
# The template must overlap known picture by this share of it.
OVERLAP = 0.5
# At full resolution so many pixels of the ring and of the hole are looked at.
SAMPLES = 1500
# Spectra of so many windows are kept.
KEPT_SPECTRA = 48


@dataclass(frozen=True)
class Stock:
    """A picture (H, W) to copy from where `source` (H, W) is true, at full and at low resolution.

    `share` is the part of each block that may be copied, `mean` its mean, both (H // COARSE,
    W // COARSE); `spectra` are transforms of windows, which neighbours search again.
    """

    picture: F32
    source: Mask
    share: F32
    mean: F32
    spectra: dict[Window, tuple[Any, Any, Any]] = field(default_factory=dict)

    @staticmethod
    def of(picture: F32, source: Mask) -> "Stock":
        """Prepare an image."""
        return Stock(picture, source, *reduced(source, picture))


def best_place(
    stock: Stock, search: Window, template: F32, *, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Return row and column in the stock where the template fits best; None if it fits nowhere.

    Its `ring` (h, w) is compared within the window `search`; all of its `hole` can be copied.
    """
    place = _rough_place(stock, search, template, ring=ring, hole=hole)
    if place is None:
        return None
    ring_at, hole_at = _evenly_chosen(ring), _evenly_chosen(hole)
    values = template[ring_at]
    for step, reach in ((2, 4), (1, 1)):
        offsets = np.arange(-reach, reach + 1, step)
        near = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
        near += np.array(place)
        limit = np.array(stock.source.shape) - hole.shape
        near = near[((near >= 0) & (near <= limit)).all(axis=1)]
        if not len(near):
            return None
        cost = _cost(stock, near, ring_at, hole_at, values)
        k = int(np.argmin(cost))
        if not np.isfinite(cost[k]):
            return None
        place = int(near[k, 0]), int(near[k, 1])
    return place


def _evenly_chosen(mask: Mask) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of up to `SAMPLES` true pixels, evenly spread."""
    pixels = np.flatnonzero(mask)
    if len(pixels) > SAMPLES:
        pixels = pixels[np.linspace(0, len(pixels) - 1, SAMPLES).astype(np.intp)]
    return pixels // mask.shape[1], pixels % mask.shape[1]


def _cost(
    stock: Stock,
    near: I64,
    ring_at: tuple[NDArray[np.intp], NDArray[np.intp]],
    hole_at: tuple[NDArray[np.intp], NDArray[np.intp]],
    values: F32,
) -> F32:
    """Return the mean squared difference in the ring at places (N, 2); inf where unknown."""
    width = stock.source.shape[1]
    source, picture = stock.source.ravel(), stock.picture.ravel()
    corner = (near[:, 0] * width + near[:, 1])[:, None]
    copyable = source[corner + (hole_at[0] * width + hole_at[1])]
    whole = copyable.sum(axis=1) >= (1 - UNKNOWN_SHARE) * copyable.shape[1]
    result = np.full(len(near), np.inf, dtype=np.float32)
    at = corner[whole] + (ring_at[0] * width + ring_at[1])
    both = source[at]
    difference = (picture[at] - values) * both
    total = np.einsum("nk,nk->n", difference, difference)
    result[whole] = total / np.maximum(both.sum(axis=1), 1)
    return result


def _rough_place(
    stock: Stock, search: Window, template: F32, *, ring: Mask, hole: Mask
) -> tuple[int, int] | None:
    """Find the best shift by correlating masked images at low resolution."""
    rows, columns = (slice(w.start // COARSE, w.stop // COARSE) for w in search)
    available = stock.share[rows, columns]
    if any(n < COARSE for n in hole.shape):
        return None
    weight, values = reduced(ring, template)
    inside = blocks(hole.astype(np.float32))
    height = available.shape[0] - weight.shape[0] + 1
    width = available.shape[1] - weight.shape[1] + 1
    if height < 1 or width < 1:
        return None
    shape = tuple(fft.next_fast_len(n, real=True) for n in available.shape)

    def transform(a: F32) -> Any:
        return fft.rfft2(a, shape)

    def back(spectrum: Any) -> F32:
        return np.asarray(fft.irfft2(spectrum, shape), dtype=np.float32)[:height, :width]

    if (rows, columns) not in stock.spectra:
        if len(stock.spectra) >= KEPT_SPECTRA:
            stock.spectra.clear()
        seen = stock.mean[rows, columns]
        stock.spectra[rows, columns] = (
            transform(available),
            transform(available * seen),
            transform(available * seen * seen),
        )
    f_available, f_seen, f_square = stock.spectra[rows, columns]
    f_weight = np.conj(transform(weight))
    missing = inside.sum() - back(f_available * np.conj(transform(inside)))
    allowed = missing < UNKNOWN_SHARE * inside.sum() + 1e-3
    if not allowed.any():
        return None
    overlap = back(f_available * f_weight)
    # Σ ring · known · (picture − template)², for every shift at once.
    cost = back(
        f_square * f_weight
        - 2.0 * f_seen * np.conj(transform(weight * values))
        + f_available * np.conj(transform(weight * values * values))
    )
    allowed &= overlap >= min(OVERLAP * float(weight.sum()), float(overlap[allowed].max()))
    mean = np.where(allowed, cost / np.maximum(overlap, 1.0), np.inf)
    top, left = np.unravel_index(int(np.argmin(mean)), mean.shape)
    return COARSE * (rows.start + int(top)), COARSE * (columns.start + int(left))


def reduced(mask: Mask, image: F32) -> tuple[F32, F32]:
    """Return the masked share of each block, and the image's mean over it (H', W'[, 3])."""
    share = blocks(mask.astype(np.float32))
    total = blocks(masked(image, mask))
    part = np.maximum(share, np.float32(1e-6))
    return share, np.asarray(total / (part if image.ndim == 2 else part[..., None]), np.float32)


def masked(image: F32, mask: Mask) -> F32:
    """Return the image where the mask is true, 0 elsewhere."""
    if not image.size:
        return image.copy()
    return np.asarray(cv2.copyTo(image, np.ascontiguousarray(mask).view(np.uint8)), np.float32)


def blocks(image: F32) -> F32:
    """Return means over blocks of `COARSE` pixels; the remainder at the end is dropped."""
    rows, columns = image.shape[0] // COARSE, image.shape[1] // COARSE
    cut = image[: rows * COARSE, : columns * COARSE]
    if not rows or not columns:
        return np.zeros((rows, columns, *image.shape[2:]), dtype=np.float32)
    return np.asarray(cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
