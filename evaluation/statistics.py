"""Means with intervals, and the comparison of two evaluations on the same episodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import beta, binomtest

RESAMPLES = 2000
LEVEL = 0.95
_BLOCK = 1_000_000  # trajectories drawn at once, to bound the memory
LEAST_PATHS = 6  # the percentile bootstrap of fewer is far too narrow


@dataclass(frozen=True)
class Interval:
    """A mean and its 95 % interval; the bounds are NaN where nothing says how sure the mean is."""

    mean: float
    low: float
    high: float


def clustered_interval(
    values: ArrayLike,
    scenes: Sequence[str],
    trajectories: Sequence[str],
    rng: np.random.Generator,
    *,
    rate: bool = False,
    resamples: int = RESAMPLES,
) -> Interval:
    """Return the mean over episodes with its percentile bootstrap interval.

    Episodes of one scene are alike, and so are those of one trajectory, which differ in their words
    only. So scenes are drawn with replacement, then trajectories within each drawn scene (Davison
    and Hinkley, "Bootstrap Methods and their Application", 1997, section 3.8). With one scene the
    interval speaks of other trajectories in that scene, not of other scenes.

    Args:
        values: (N,) one per episode; NaN and infinite ones are left out.
        scenes: (N,) of each episode.
        trajectories: (N,) of each episode, unique within a scene.
        rate: values are 0 or 100, and then fewer than `LEAST_PATHS` trajectories have an interval,
            too: Clopper's and Pearson's for their number. So have draws that would not vary, of
            nothing but zeros or hundreds.
    """
    array = np.asarray(values, np.float64)
    groups: dict[str, dict[str, list[float]]] = {}
    for value, scene, trajectory in zip(array.tolist(), scenes, trajectories, strict=True):
        if math.isfinite(value):
            groups.setdefault(scene, {}).setdefault(trajectory, []).append(value)
    if not groups:
        return Interval(np.nan, np.nan, np.nan)
    finite = array[np.isfinite(array)]
    mean = float(finite.mean())
    paths = sum(map(len, groups.values()))
    # SPL is a rate only where every path is perfect or a failure.
    counted = rate and bool(np.isin(finite, (0.0, 100.0)).all())
    if counted and (paths < LEAST_PATHS or mean in (0.0, 100.0)):
        return _exact(mean, paths)
    if paths < LEAST_PATHS:
        return Interval(mean, np.nan, np.nan)
    # (T, 2) sum and count of each trajectory, one array per scene.
    totals = [np.array([(sum(v), len(v)) for v in scene.values()]) for scene in groups.values()]
    block = max(1, _BLOCK // paths)
    means = np.concatenate(
        [
            _resampled_means(totals, min(block, resamples - first), rng)
            for first in range(0, resamples, block)
        ]
    )
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(mean, float(low), float(high))


def _resampled_means(
    totals: Sequence[NDArray[np.float64]], count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the means (count,) of as many draws of scenes, and of trajectories within them."""
    drawn = rng.integers(len(totals), size=(count, len(totals)))
    sums = np.zeros((count, 2))
    for scene, paths in enumerate(totals):
        draws = np.nonzero(drawn == scene)[0]  # a draw that has the scene twice is here twice
        chosen = rng.integers(len(paths), size=(len(draws), len(paths)))
        np.add.at(sums, draws, paths[chosen].sum(axis=1))
    return sums[:, 0] / sums[:, 1]


def _exact(mean: float, paths: int) -> Interval:
    """Return a rate [%] with Clopper's and Pearson's interval for a number of independent paths.

    Where texts of one path end differently, the number of successes is no whole one; the beta
    distribution takes it as it is (Korn and Graubard, Survey Methodology 24, 1998).
    """
    good = paths * mean / 100
    tail = (1 - LEVEL) / 2
    low = beta.ppf(tail, good, paths - good + 1) if mean > 0 else 0.0
    high = beta.ppf(1 - tail, good + 1, paths - good) if mean < 100 else 1.0
    return Interval(mean, 100 * float(low), 100 * float(high))


@dataclass(frozen=True)
class Flips:
    """Episodes that two evaluations judged differently.

    Attributes:
        lost: good in the first, bad in the second, by position.
        won: bad in the first, good in the second.
        p_value: exact McNemar test (a binomial test of the flips against one half): how
            likely so one-sided a split is when both are equally good.
    """

    lost: tuple[int, ...]
    won: tuple[int, ...]
    p_value: float


def mcnemar(first: ArrayLike, second: ArrayLike) -> Flips:
    """Compare two (N,) series of successes on the same episodes."""
    a, b = np.asarray(first, bool), np.asarray(second, bool)
    lost, won = np.flatnonzero(a & ~b), np.flatnonzero(b & ~a)
    flips = len(lost) + len(won)
    p_value = float(binomtest(len(won), flips).pvalue) if flips else 1.0
    return Flips(tuple(lost.tolist()), tuple(won.tolist()), p_value)
