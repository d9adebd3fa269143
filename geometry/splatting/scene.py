"""Gaussians prepared for drawing: in chunks of neighbours, with bounds to cull them by."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, I64, Array
from ...formats.splats.harmonics import C0
from ...formats.splats.record import GaussianCloud, covariances
from .detail import LEVELS, Level, merged, widths

CHUNK = 256
# The least opacity that is drawn, as in the reference implementation.
MIN_ALPHA = 1 / 255
MORTON_BITS = 20
# Gaussians four times as large go into chunks of their own, whose bounds would otherwise be loose.
CLASS_RATIO, CLASSES = 4.0, 8
# Coefficients of the harmonics are kept in steps of this size, which hold −4 … 4.
STEP = 1 / 8192


@dataclass(frozen=True)
class SplatScene:
    """Gaussians in C chunks of `CHUNK`, sorted by size class and place, at L levels of detail.

    Chunk c of level k has number k C + c. Level 0 is the capture itself; in the others neighbours
    are merged.

    Attributes:
        position: (N, 3) float32 centres, world [m].
        covariance: (N, 6) float32 xx, xy, xz, yy, yz, zz [m²].
        opacity: (N,) float32.
        color: (N, 3) float32 sRGB 0–1 without view dependence.
        harmonics: (N, K, 3) int16 coefficients of degree ≥ 1 in steps of `STEP`; K may be 0.
        starts: (L C + 1,) int64 first row of each chunk, and the end of the last.
        low, high: (L C, 3) float32 bounds of the centres in each chunk [m].
        reach: (L C,) float32 how far a Gaussian of the chunk is visible from its centre [m].
        width: (L, C) float32 typical standard deviation of the chunk's Gaussians [m].
        antialiased: whether the opacity makes up for the blur of a pixel (Mip-Splatting).
    """

    position: F32
    covariance: F32
    opacity: F32
    color: F32
    harmonics: NDArray[np.int16]
    starts: I64
    low: F32
    high: F32
    reach: F32
    width: F32
    antialiased: bool

    @staticmethod
    def of(
        cloud: GaussianCloud, *, antialiased: bool | None = None, detail: bool = False
    ) -> "SplatScene":
        """Prepare a cloud in world coordinates.

        Args:
            antialiased: None = as the cloud was trained.
            detail: add coarser levels, which take a third of the memory more.
        """
        filtered = cloud.antialiased if antialiased is None else antialiased
        order = _order(cloud)
        cloud = cloud.take(order[cloud.opacity[order] >= MIN_ALPHA])
        starts = np.r_[np.arange(0, len(cloud), CHUNK), len(cloud)].astype(np.int64)
        if not len(cloud):
            starts = np.zeros(1, dtype=np.int64)
        levels = [Level(cloud.position, covariances(cloud), cloud.opacity, cloud.harmonics, starts)]
        while detail and len(cloud) and len(levels) < LEVELS:
            levels.append(merged(levels[-1], antialiased=filtered))
        whole = Level.joined(levels)
        position, covariance, opacity = whole.position, whole.covariance, whole.opacity
        size = np.sqrt(_largest_variance(covariance))
        seen = size * np.sqrt(2 * np.log(np.maximum(opacity / MIN_ALPHA, 1)))
        few, firsts = len(cloud) == 0, whole.starts[:-1]
        empty = np.zeros((0, 3), dtype=np.float32)
        return SplatScene(
            position=np.ascontiguousarray(position),
            covariance=covariance,
            opacity=np.ascontiguousarray(opacity),
            color=(0.5 + np.float32(C0) * whole.coefficients[:, 0]).astype(np.float32),
            harmonics=_stepped(whole.coefficients[:, 1:]),
            starts=whole.starts,
            low=empty if few else np.minimum.reduceat(position, firsts),
            high=empty if few else np.maximum.reduceat(position, firsts),
            reach=empty[:, 0] if few else np.maximum.reduceat(seen, firsts).astype(np.float32),
            width=widths(covariance, whole.starts).reshape(len(levels), -1),
            antialiased=filtered,
        )

    def __len__(self) -> int:
        return len(self.position)

    @property
    def nbytes(self) -> int:
        """Return the memory of all arrays."""
        return sum(v.nbytes for v in vars(self).values() if isinstance(v, np.ndarray))


def _largest_variance(covariance: F32) -> Array:
    """Return at least the largest variance (N,) along any direction [m²], by Gershgorin's discs."""
    xx, xy, xz, yy, yz, zz = covariance.astype(np.float64).T
    rows = (xx + abs(xy) + abs(xz), yy + abs(xy) + abs(yz), zz + abs(xz) + abs(yz))
    return np.minimum(np.maximum.reduce(rows), xx + yy + zz)


def _stepped(harmonics: F32) -> NDArray[np.int16]:
    """Return coefficients as integers, in blocks of memory."""
    out = np.empty(harmonics.shape, dtype=np.int16)
    for first in range(0, len(out), 1 << 18):
        part = slice(first, first + (1 << 18))
        out[part] = np.clip(np.rint(harmonics[part] / STEP), -32768, 32767)
    return out


def _order(cloud: GaussianCloud) -> I64:
    """Return the Gaussians by size class, then along a Morton curve."""
    if not len(cloud):
        return np.zeros(0, dtype=np.int64)
    size = np.maximum(cloud.scale.max(1), 1e-9)
    grade = np.floor(np.log(size / np.median(size)) / np.log(CLASS_RATIO))
    grade = np.clip(grade, -1, CLASSES - 2).astype(np.int64) + 1
    low, high = (np.quantile(cloud.position, q, axis=0) for q in (0.001, 0.999))
    share = np.clip((cloud.position - low) / max(float((high - low).max()), 1e-9), 0, 1)
    cells = (share * ((1 << MORTON_BITS) - 1)).astype(np.uint64)
    key = grade.astype(np.uint64) << np.uint64(3 * MORTON_BITS)
    for axis in range(3):
        key |= _spread(cells[:, axis]) << np.uint64(axis)
    return np.argsort(key)


def _spread(value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zero bits between the bits of 21-bit integers."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        value = (value | value << np.uint64(shift)) & np.uint64(mask)
    return value
