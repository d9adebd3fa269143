"""Feature statistics, numerically those of LeRobot 0.6.1's own writer.

Per episode: minimum, maximum, mean, standard deviation, count, and the 1, 10, 50, 90 and 99 %
quantiles, read from a histogram of 5,000 bins between minimum and maximum with linear
interpolation inside a bin. Over a dataset: counts weigh means, variances and quantiles.
Computation keeps each column's own precision, because bins are decided by it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import F32, I64, Array
from ..core.camera import DepthRange
from ..video.depth_codes import MAX_CODE, codes_to_depth, codes_to_millimetres
from .layout import DEPTH_KEY, RGB_KEY

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
MOMENTS = ("min", "max", "mean", "std", "count")
BINS = 5000
PADDING = 1e-10

Statistics = dict[str, NDArray[Any]]


def column_statistics(values: NDArray[Any]) -> Statistics:
    """Return the statistics of a column (N, D) or (N,); each entry (D,), `count` (1,)."""
    columns = values.reshape(len(values), -1)
    columns = columns.astype(np.result_type(columns.dtype, np.float32), copy=False)
    lower, upper = columns.min(axis=0), columns.max(axis=0)
    mean: NDArray[Any] = columns.mean(axis=0)
    count = np.array([len(values)])
    result: Statistics = {"min": lower, "max": upper, "mean": mean, "count": count}
    if len(values) == 1:
        result["std"] = np.zeros_like(mean)
        return result | dict.fromkeys(QUANTILES, mean)
    result["std"] = np.sqrt(np.maximum(0, (columns**2).mean(axis=0) - mean**2))
    return result | dict(zip(QUANTILES, _column_quantiles(columns), strict=True))


def image_statistics(values: F32, counts: I64, frames: int) -> Statistics:
    """Return the statistics of images from how often each value occurs.

    Args:
        values: (K,) ascending pixel values.
        counts: (C, K) occurrences in each channel; each channel has at least one.
        frames: number of images, the `count` (1,); other entries are (C, 1, 1).
    """
    channels = []
    for weights in counts:
        seen = weights > 0
        x, n = values[seen], weights[seen].astype(np.float64)
        mean = np.average(x.astype(np.float64), weights=n)
        variance = np.average((x - mean) ** 2, weights=n)
        quantiles = _quantiles(x, n)
        channels.append([x[0], x[-1], mean, np.sqrt(variance), *quantiles])
    table = np.array(channels, dtype=np.float64).T[:, :, None, None]
    result: Statistics = dict(zip(["min", "max", "mean", "std", *QUANTILES], table, strict=True))
    return result | {"count": np.array([frames])}


class StatisticsSum:
    """Statistics of a whole dataset, added up episode by episode in constant memory."""

    def __init__(self) -> None:
        self._features: dict[str, Statistics] = {}

    def add(self, episode: dict[str, Statistics]) -> None:
        """Add the statistics of one episode's features."""
        for key, new in episode.items():
            old = self._features.get(key)
            self._features[key] = new if old is None else _merge(old, new)

    def result(self) -> dict[str, dict[str, Any]]:
        """Return the statistics as JSON values."""
        return {key: statistics_to_json(value) for key, value in self._features.items()}


def picture_statistics(
    rgb_counts: I64, depth_counts: I64, depth_range: DepthRange, length: int, millimetres: bool
) -> dict[str, Statistics]:
    """Return the statistics of an episode's colours and depth, from how often each value occurs.

    Args:
        rgb_counts: (3, 256).
        depth_counts: (4096,) of depth codes.
        millimetres: whether depth is stored as images of millimetres, not as a video of codes.
    """
    rgb = image_statistics(np.arange(256, dtype=np.float32), rgb_counts, length)
    codes = np.arange(MAX_CODE + 1, dtype=np.uint16)
    if millimetres:
        depths = codes_to_millimetres(codes, depth_range).astype(np.float32)
    else:
        depths = codes_to_depth(codes, depth_range)
    return {
        # LeRobot scales colours to 0 … 1 and leaves depth in its unit.
        RGB_KEY: {k: v if k == "count" else v / 255.0 for k, v in rgb.items()},
        DEPTH_KEY: image_statistics(depths, depth_counts[None], length),
    }


def statistics_to_json(statistics: Statistics) -> dict[str, Any]:
    """Convert arrays to nested lists, in LeRobot's order."""
    return {key: np.asarray(statistics[key]).tolist() for key in (*MOMENTS, *QUANTILES)}


def statistics_from_json(statistics: dict[str, Any]) -> Statistics:
    """Convert nested lists to arrays."""
    return {key: np.asarray(value) for key, value in statistics.items()}


def _merge(a: Statistics, b: Statistics) -> Statistics:
    count = a["count"] + b["count"]
    share = b["count"][0] / count[0]
    delta = b["mean"] - a["mean"]
    # Chan et al.'s parallel variance.
    variance = (1 - share) * a["std"] ** 2 + share * b["std"] ** 2 + share * (1 - share) * delta**2
    merged: Statistics = {
        "min": np.minimum(a["min"], b["min"]),
        "max": np.maximum(a["max"], b["max"]),
        "mean": a["mean"] + share * delta,
        "std": np.sqrt(variance),
        "count": count,
    }
    return merged | {key: (1 - share) * a[key] + share * b[key] for key in QUANTILES}


def _column_quantiles(columns: NDArray[Any]) -> Array:
    """Return histogram quantiles (Q, D) of columns (N, D): `_quantiles`, for all at once."""
    ascending = np.sort(columns, axis=0)
    edges = [_edges(column) for column in ascending.T]
    bins = np.stack([_bins(e, column) for e, column in zip(edges, ascending.T, strict=True)], 1)
    targets = np.array(list(QUANTILES.values())) * len(columns)
    picked = bins[np.ceil(targets).astype(int) - 1]
    before = np.sum(bins < picked[:, None], axis=1)
    in_bin = np.sum(bins <= picked[:, None], axis=1) - before
    fraction = (targets[:, None] - before) / in_bin
    lower, upper = (
        np.stack([e[at] for e, at in zip(edges, (picked + k).T, strict=True)], 1) for k in (0, 1)
    )
    first = np.array([e[0] for e in edges])
    return np.where(picked == 0, first, lower + fraction * (upper - lower))


def _quantiles(values: NDArray[Any], weights: Array) -> Array:
    """Return the histogram quantiles of ascending `values` (N,) that occur `weights` (N,) times."""
    edges = _edges(values)
    bins = _bins(edges, values)
    first = np.flatnonzero(np.diff(bins, prepend=-1))  # first value of each occupied bin
    occupied = bins[first]
    in_bin = np.add.reduceat(weights, first)
    cumulated = np.cumsum(in_bin)
    targets = np.array(list(QUANTILES.values())) * cumulated[-1]
    at = np.searchsorted(cumulated, targets)
    fraction = (targets - (cumulated[at] - in_bin[at])) / in_bin[at]
    lower, upper = edges[occupied[at]], edges[occupied[at] + 1]
    # LeRobot does not interpolate in the very first bin.
    return np.where(occupied[at] == 0, edges[0], lower + fraction * (upper - lower))


def _edges(ascending: NDArray[Any]) -> NDArray[Any]:
    return np.linspace(ascending[0] - PADDING, ascending[-1] + PADDING, BINS + 1)


def _bins(edges: NDArray[Any], values: NDArray[Any]) -> I64:
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, BINS - 1)
