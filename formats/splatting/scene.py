"""Gaussians prepared for drawing: in chunks of neighbours, with bounds to cull them by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..splats.harmonics import C0
from ..splats.record import F32, GaussianCloud, covariances

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
    """N Gaussians in C chunks of `CHUNK`, sorted by size class and place.

    Attributes:
        position: (N, 3) float32 centres, world [m].
        covariance: (N, 6) float32 xx, xy, xz, yy, yz, zz [m²].
        opacity: (N,) float32.
        color: (N, 3) float32 sRGB 0–1 without view dependence.
        harmonics: (N, K, 3) int16 coefficients of degree ≥ 1 in steps of `STEP`; K may be 0.
        low, high: (C, 3) float32 bounds of the centres in each chunk [m].
        reach: (C,) float32 how far a Gaussian of the chunk is visible from its centre [m].
        antialiased: whether the opacity makes up for the blur of a pixel (Mip-Splatting).
    """

    position: F32
    covariance: F32
    opacity: F32
    color: F32
    harmonics: NDArray[np.int16]
    low: F32
    high: F32
    reach: F32
    antialiased: bool

    @staticmethod
    def of(cloud: GaussianCloud, *, antialiased: bool | None = None) -> SplatScene:
        """Prepare a cloud in world coordinates; `antialiased` None = as it was trained."""
        order = _order(cloud)
        cloud = cloud.take(order[cloud.opacity[order] >= MIN_ALPHA])
        size = cloud.scale.max(1)
        seen = size * np.sqrt(2 * np.log(np.maximum(cloud.opacity / MIN_ALPHA, 1)))
        starts = np.arange(0, len(cloud), CHUNK)
        empty = np.zeros((0, 3), dtype=np.float32)
        few = len(cloud) == 0
        return SplatScene(
            position=np.ascontiguousarray(cloud.position),
            covariance=covariances(cloud),
            opacity=np.ascontiguousarray(cloud.opacity),
            color=(0.5 + np.float32(C0) * cloud.harmonics[:, 0]).astype(np.float32),
            harmonics=_stepped(cloud.harmonics[:, 1:]),
            low=empty if few else np.minimum.reduceat(cloud.position, starts),
            high=empty if few else np.maximum.reduceat(cloud.position, starts),
            reach=empty[:, 0] if few else np.maximum.reduceat(seen, starts).astype(np.float32),
            antialiased=cloud.antialiased if antialiased is None else antialiased,
        )

    def __len__(self) -> int:
        return len(self.position)

    @property
    def nbytes(self) -> int:
        """Return the memory of all arrays."""
        return sum(v.nbytes for v in vars(self).values() if isinstance(v, np.ndarray))


def _stepped(harmonics: F32) -> NDArray[np.int16]:
    """Return coefficients as integers, in blocks of memory."""
    out = np.empty(harmonics.shape, dtype=np.int16)
    for first in range(0, len(out), 1 << 18):
        part = slice(first, first + (1 << 18))
        out[part] = np.clip(np.rint(harmonics[part] / STEP), -32768, 32767)
    return out


def _order(cloud: GaussianCloud) -> NDArray[np.int64]:
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
