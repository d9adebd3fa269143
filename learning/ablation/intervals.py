"""Confidence intervals of means and of differences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from .evaluate import EpisodeScore, Summary

CONFIDENCE = 0.95
FEW = 6  # held-out trajectories below which an interval needs a word of caution
_RESAMPLES = 2000


@dataclass(frozen=True)
class Estimate:
    """A mean, and half the width of its interval, which is NaN for a single value."""

    mean: float
    half: float


@dataclass(frozen=True)
class Difference:
    """A difference of means with its interval, whose ends are NaN if they cannot be estimated."""

    mean: float
    low: float
    high: float


def over_seeds(values: Sequence[float]) -> Estimate:
    """Return the mean over trainings, with Student's t-interval at 95 %."""
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
    """Return the difference of two mixtures' summaries, ours − theirs, by metric, at 95 %.

    It covers both sources of variance. Seeds: the squared standard error of each mixture's mean
    over its trainings. Trajectories: the variance of the difference over bootstrap samples of them,
    the same for both mixtures, because both predict the same ones. The width is Student's t with
    the degrees of freedom of the sum (Welch, 1947; Satterthwaite, 1946): with few trainings an
    interval from resampled seeds alone would be much too narrow. With one training, or one
    trajectory, the variance is unknown and the ends are NaN.

    Args:
        ours: by seed, scores of held-out episodes.
        theirs: scores of the same episodes in the same order.

    Raises:
        ValueError: not the same episodes.
    """
    names = [score.trajectory for score in ours[0]]
    if any([s.trajectory for s in run] != names for run in (*ours, *theirs)):
        raise ValueError("the runs to compare have not predicted the same episodes")
    trajectories, member = np.unique(names, return_inverse=True)
    a = np.stack([_counts(run, member, len(trajectories)) for run in ours])
    b = np.stack([_counts(run, member, len(trajectories)) for run in theirs])
    of_ours, of_theirs = _metrics(a.sum(1)), _metrics(b.sum(1))  # (seeds, 3)
    mean = of_ours.mean(0) - of_theirs.mean(0)
    half = np.full(3, np.nan)
    if min(len(a), len(b), len(trajectories)) > 1:
        # How often each trajectory is drawn, (resamples, trajectories).
        count = len(trajectories)
        times = rng.multinomial(count, np.full(count, 1 / count), _RESAMPLES).astype(np.float64)
        drawn = [_metrics(np.einsum("rt,stk->rsk", times, runs)).mean(1) for runs in (a, b)]
        variances = np.stack(
            [
                of_ours.var(0, ddof=1) / len(a),
                of_theirs.var(0, ddof=1) / len(b),
                # A bootstrap variance is that of n values divided by n, not n − 1.
                (drawn[0] - drawn[1]).var(0, ddof=1) * count / (count - 1),
            ]
        )
        half = half_width(variances, np.array([len(a), len(b), count]) - 1)
    return {
        name: Difference(float(mean[k]), float(mean[k] - half[k]), float(mean[k] + half[k]))
        for k, name in enumerate(Summary.__dataclass_fields__)
    }


def caution(trainings: int, trajectories: int) -> str:
    """Return why differences have no interval, or a doubtful one; empty if there is no reason.

    Args:
        trainings: per row.
        trajectories: held out.
    """
    missing = []
    if trajectories < 2:
        missing.append("one held-out trajectory cannot show how much trajectories vary")
    if trainings < 2:
        missing.append("one training per row cannot show how much trainings vary")
    if missing:
        return f"no interval, because {' and '.join(missing)}."
    if trajectories < FEW:
        return (
            f"the intervals rest on {trajectories} held-out trajectories only, so they are wide, "
            "and other trajectories may differ more than these do."
        )
    return ""


def half_width(variances: NDArray[np.float64], freedom: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return half the width (K,) of an interval of a sum of parts with `variances` (P, K).

    Args:
        variances: of the parts.
        freedom: (P,) degrees of freedom with which each was estimated.
    """
    total = variances.sum(0)
    spread = (variances**2 / freedom[:, None]).sum(0)
    # Nothing varies: no width, whatever the degrees of freedom.
    degrees = np.divide(total**2, spread, out=np.ones_like(total), where=spread > 0)
    return student_t.ppf(0.5 + CONFIDENCE / 2, degrees) * np.sqrt(total)


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
    """Return (trajectories, 8) sums over the episodes of each trajectory."""
    table = np.array([[getattr(score, name) for name in _COLUMNS] for score in scores], float)
    result = np.zeros((count, len(_COLUMNS)))
    np.add.at(result, member, table)
    return result


def _metrics(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (…, 3) action, waypoint_m and stop of (…, 8) sums, as `Summary` has them."""
    parts = sums[..., 0::2] / np.maximum(sums[..., 1::2], 1)
    return np.stack([parts[..., 0], parts[..., 1], (parts[..., 2] + parts[..., 3]) / 2], -1)
