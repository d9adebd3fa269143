"""Coarser levels of detail: neighbouring Gaussians merged into one where they are below a pixel.

A merged Gaussian has the mean and covariance of those it stands for, weighted by what each covers,
and an opacity that lets as much light through.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...formats.core.arrays import F32, I64, Array, Floats

# Gaussians merged into one from each level to the next.
FAN = 4
LEVELS = 5
# Chunks that are merged together: the intermediate numbers of all at once would take gigabytes.
BLOCK = 4096
# A merged Gaussian wider than this multiple of its parts' typical width bridges a gap; its parts
# then stay as they are.
WIDEST = 4.0
OPAQUE = 0.995


@dataclass(frozen=True)
class Level:
    """Gaussians in chunks, as `SplatScene` has them.

    Attributes:
        position: (N, 3) float32 [m].
        covariance: (N, 6) float32 [m²].
        opacity: (N,) float32.
        coefficients: (N, K, 3) float32 colour and harmonics.
        starts: (C + 1,) int64 first row of each chunk, and the end of the last.
    """

    position: F32
    covariance: F32
    opacity: F32
    coefficients: F32
    starts: I64

    @staticmethod
    def joined(levels: Sequence["Level"]) -> "Level":
        """Return the chunks of all levels, one level after the other."""
        names = ("position", "covariance", "opacity", "coefficients")
        rows = np.cumsum([0, *(len(level.position) for level in levels)])
        starts = [level.starts[:-1] + row for level, row in zip(levels, rows, strict=False)]
        values = {name: np.concatenate([getattr(v, name) for v in levels]) for name in names}
        return Level(**values, starts=np.concatenate([*starts, rows[-1:]]).astype(np.int64))


def merged(level: Level, *, antialiased: bool) -> Level:
    """Return the next coarser level; chunks keep their numbers.

    Args:
        antialiased: whether a Gaussian's opacity is lowered by what a pixel's blur adds to its
            area. What many small ones then cover adds up, so that the opacity of one that stands
            for them may exceed 1 before it is lowered.
    """
    chunks = len(level.starts) - 1
    parts = [
        _merged(_cut(level, first, min(first + BLOCK, chunks)), antialiased=antialiased)
        for first in range(0, chunks, BLOCK)
    ]
    return Level.joined(parts)


def _cut(level: Level, first: int, end: int) -> Level:
    """Return the chunks from `first` to `end` (exclusive)."""
    rows = slice(level.starts[first], level.starts[end])
    return Level(
        level.position[rows],
        level.covariance[rows],
        level.opacity[rows],
        level.coefficients[rows],
        level.starts[first : end + 1] - level.starts[first],
    )


def _merged(level: Level, *, antialiased: bool) -> Level:
    count = np.diff(level.starts)
    chunk_of = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(chunk_of)) - level.starts[chunk_of]
    # Groups of neighbours in a chunk, which is sorted along a curve that fills space.
    per_chunk = -(-count // FAN)
    group = (np.cumsum(per_chunk) - per_chunk)[chunk_of] + rank // FAN
    groups = int(per_chunk.sum())
    starts = np.flatnonzero(np.r_[True, group[1:] != group[:-1]])
    cover = _cover(level.covariance)
    depth = level.opacity
    if not antialiased:
        depth = -np.log1p(-np.minimum(level.opacity, np.float32(OPAQUE)))
    weight = (depth * cover).astype(np.float64)
    total = np.maximum(np.add.reduceat(weight, starts), 1e-30)
    share = (weight / total[group])[:, None]

    def mean(values: Floats) -> Array:
        return np.add.reduceat(share * values, starts)

    center = mean(level.position)
    off = level.position - center[group]
    spread = np.stack([off[:, i] * off[:, j] for i, j in _PAIRS], axis=1)
    covariance = mean(level.covariance + spread)
    wide = np.sqrt(np.trace(_full(covariance), axis1=1, axis2=2))
    usual = np.sqrt(mean(level.covariance[:, [0, 3, 5]].sum(1, keepdims=True))[:, 0])
    opacity = total / np.maximum(_cover(covariance), 1e-30)
    if not antialiased:
        opacity = np.minimum(1 - np.exp(-opacity), OPAQUE)
    size = np.add.reduceat(np.ones(len(group)), starts)
    whole = (wide <= WIDEST * usual) & (size > 1)
    coefficients = mean(level.coefficients.reshape(len(group), -1))
    # Rows of the new level: one for each merged group, all parts of the others.
    first = np.zeros(len(group), dtype=bool)
    first[starts] = True
    remaining = first | ~whole[group]
    to = group[remaining]
    use = whole[to]

    def rows(own: F32, joint: Array) -> F32:
        shape = (-1, *([1] * (own.ndim - 1)))
        flat = joint.reshape(groups, *own.shape[1:])
        return np.where(use.reshape(shape), flat[to], own[remaining]).astype(np.float32)

    ends = np.cumsum(np.bincount(chunk_of[remaining], minlength=len(count)))
    return Level(
        rows(level.position, center),
        rows(level.covariance, covariance),
        rows(level.opacity, opacity),
        rows(level.coefficients, coefficients),
        np.r_[0, ends].astype(np.int64),
    )


def widths(covariance: F32, starts: I64) -> F32:
    """Return the typical standard deviation (C,) of each chunk's Gaussians [m]: that of 90 %."""
    largest = np.sqrt(np.maximum(covariance[:, [0, 3, 5]].max(1), 0))
    return np.array([np.quantile(largest[a:b], 0.9) for a, b in pairwise(starts)], dtype=np.float32)


_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _full(covariance: Floats) -> Array:
    """Return covariances (N, 6) as matrices (N, 3, 3)."""
    return covariance[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3).astype(np.float64)


def _cover(covariance: Floats) -> Array:
    """Return the area (N,) that Gaussians cover, seen from where they are widest [m²].

    It is the square root of the sum of the principal 2 × 2 minors: the product of the two larger
    standard deviations, if the third is small.
    """
    xx, xy, xz, yy, yz, zz = covariance.astype(np.float64).T
    minors = xx * yy - xy**2 + xx * zz - xz**2 + yy * zz - yz**2
    return np.sqrt(np.maximum(minors, 1e-30))
