"""How sure a number is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from .evaluate import EpisodeScore, Summary

CONFIDENCE = 0.95
_RESAMPLES = 2000


@dataclass(frozen=True)
class Estimate:
    """A mean, and half the width of its interval; NaN where one value tells nothing of it."""

    mean: float
    half: float


@dataclass(frozen=True)
class Difference:
    """A difference of means with its interval."""

    mean: float
    low: float
    high: float


def over_seeds(values: Sequence[float]) -> Estimate:
    """Mean over trainings, with Student's t-interval at 95 %."""
    array = np.asarray(values, np.float64)
    count = len(array)
    if count < 2:
        return Estimate(float(array.mean()), float("nan"))
    quantile = student_t.ppf(0.5 + CONFIDENCE / 2, count - 1)
    return Estimate(float(array.mean()), float(quantile * array.std(ddof=1) / np.sqrt(count)))


def paired_differences(
    ours: Sequence[Sequence[EpisodeScore]],
    theirs: Sequence[Sequence[EpisodeScore]],
    rng: np.random.Generator,
) -> Mapping[str, Difference]:
    """Difference of two mixtures' summaries, ours − theirs, by metric, at 95 %.

    Bootstrap over both things that vary: seeds are drawn with replacement for each mixture, and
    trajectories with replacement for both together, because both predict the same ones.

    Args:
        ours: by seed, scores of held-out episodes.
        theirs: scores of the same episodes in the same order.
        rng: of the resamples.

    Raises:
        ValueError: not the same episodes.
    """
    names = [score.trajectory for score in ours[0]]
    if any([s.trajectory for s in run] != names for run in (*ours, *theirs)):
        raise ValueError("the runs to compare have not predicted the same episodes")
    trajectories, member = np.unique(names, return_inverse=True)
    a = np.stack([_counts(run, member, len(trajectories)) for run in ours])
    b = np.stack([_counts(run, member, len(trajectories)) for run in theirs])
    differences = np.empty((_RESAMPLES, 3))
    for k in range(_RESAMPLES):
        drawn = rng.integers(0, len(trajectories), len(trajectories))
        of_ours = a[rng.integers(0, len(a), len(a))][:, drawn].sum(1)
        of_theirs = b[rng.integers(0, len(b), len(b))][:, drawn].sum(1)
        differences[k] = _metrics(of_ours).mean(0) - _metrics(of_theirs).mean(0)
    mean = _metrics(a.sum(1)).mean(0) - _metrics(b.sum(1)).mean(0)
    edge = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(differences, [edge, 100 - edge], axis=0)
    return {
        name: Difference(float(mean[k]), float(low[k]), float(high[k]))
        for k, name in enumerate(Summary.__dataclass_fields__)
    }


_COLUMNS = (
    "correct",
    "frames",
    "waypoint_error_m",
    "waypoints",
    "near_found",
    "near",
    "far_found",
    "far",
)


def _counts(
    scores: Sequence[EpisodeScore], member: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """(trajectories, 8) sums over the episodes of each trajectory."""
    table = np.array([[getattr(score, name) for name in _COLUMNS] for score in scores], float)
    result = np.zeros((count, len(_COLUMNS)))
    np.add.at(result, member, table)
    return result


def _metrics(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """(…, 3) action, waypoint_m and stop of (…, 8) sums, as `Summary` has them."""
    parts = sums[..., 0::2] / np.maximum(sums[..., 1::2], 1)
    return np.stack([parts[..., 0], parts[..., 1], (parts[..., 2] + parts[..., 3]) / 2], -1)
