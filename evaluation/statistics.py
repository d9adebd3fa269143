"""Means with intervals over episodes, scenes and seeds, and comparisons on the same episodes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# `scipy.stats` has the same, and takes most of a second to import.
from scipy.special import bdtr, betaincinv, ndtri, stdtrit

from ..formats.core.errors import InputError

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
    # (2, T) sums and counts of the trajectories, one array per scene.
    totals = [
        np.array([[*map(sum, scene.values())], [*map(len, scene.values())]], np.float64)
        for scene in groups.values()
    ]
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
    sums = np.zeros((2, count))
    for scene, paths in enumerate(totals):
        draws = np.nonzero(drawn == scene)[0]  # a draw that has the scene twice is here twice
        chosen = rng.integers(paths.shape[1], size=(len(draws), paths.shape[1]))
        for total, per_path in zip(sums, paths, strict=True):
            total += np.bincount(draws, per_path[chosen].sum(axis=1), count)
    return sums[0] / sums[1]


def _exact(mean: float, paths: int) -> Interval:
    """Return a rate [%] with Clopper's and Pearson's interval for a number of independent paths.

    Where texts of one path end differently, the number of successes is no whole one; the beta
    distribution takes it as it is (Korn and Graubard, Survey Methodology 24, 1998).
    """
    good = paths * mean / 100
    tail = (1 - LEVEL) / 2
    low = betaincinv(good, paths - good + 1, tail) if mean > 0 else 0.0
    high = betaincinv(good + 1, paths - good, 1 - tail) if mean < 100 else 1.0
    return Interval(mean, 100 * float(low), 100 * float(high))


@dataclass(frozen=True)
class Trials:
    """One metric of a policy's walks under all its seeds.

    Attributes:
        uids, scenes, trajectories: (N,) of the episodes.
        values: (S, N), one row per seed; NaN where a walk has no result.
    """

    uids: tuple[str, ...]
    scenes: tuple[str, ...]
    trajectories: tuple[str, ...]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Variance:
    """A variance of a mean, and the degrees of freedom with which it was estimated."""

    value: float
    freedom: int

    def scaled(self, factor: int) -> "Variance":
        """Return the variance that `factor` times as many samples would have."""
        return Variance(self.value / factor, (self.freedom + 1) * factor - 1)


@dataclass(frozen=True)
class Difference(Interval):
    """A difference of means with its interval.

    Attributes:
        seeds, scenes: the variances between seeds (of both policies), and between scenes and paths.
    """

    seeds: tuple[Variance, Variance]
    scenes: Variance

    @property
    def half_width(self) -> float:
        """Half the width of the interval: about the smallest difference that it can show."""
        return (self.high - self.low) / 2

    @property
    def seeds_share(self) -> float:
        """Part of the variance that lies between seeds, 0 to 1; NaN if nothing varies."""
        between = sum(part.value for part in self.seeds)
        total = between + self.scenes.value
        return between / total if total else math.nan

    def factor_to_show(self, difference: float, most: int = 1000) -> int | None:
        """Return by what factor seeds and scenes must grow for so small a difference to be shown.

        None if it is more than `most`, or nothing says how much the means vary.
        """
        parts = (*self.seeds, self.scenes)
        for factor in range(1, most + 1):
            if _half_width([part.scaled(factor) for part in parts]) <= difference:
                return factor
        return None


def mean_over_seeds(trials: Trials, *, rate: bool) -> Interval:
    """Return the mean with its 95 % interval over seeds and scenes; see `difference`.

    Args:
        rate: values are 0 or 100; the interval stays within, and where nothing varies it is
            Clopper's and Pearson's.
    """
    values = trials.values
    mean = float(np.nanmean(values)) if np.isfinite(values).any() else math.nan
    if rate and mean in (0.0, 100.0):
        place = (trials.scenes, trials.trajectories, np.random.default_rng(0))
        exact = clustered_interval(values[0], *place, rate=True)
        return Interval(mean, exact.low, exact.high)
    half = _half_width([_between_seeds(values), _between_scenes(trials, values.mean(0))])
    low, high = mean - half, mean + half
    return Interval(mean, max(low, 0.0), min(high, 100.0)) if rate else Interval(mean, low, high)


def difference(more: Trials, less: Trials) -> Difference:
    """Return the difference of two policies' means with its 95 % interval over seeds and scenes.

    Three variances are added, and the width is Student's t with the degrees of freedom of the sum
    (Welch, 1947; Satterthwaite, 1946): of each policy's mean over its seeds, and of the seeds' mean
    difference over scenes and paths (the clustered bootstrap), paired by episode. With few seeds an
    interval from resampled seeds alone would be much too narrow. One seed says nothing of others,
    so the interval does not cover them. With fewer than `LEAST_PATHS` paths the bounds are NaN.

    Raises:
        InputError: The policies did not walk the same episodes.
    """
    if more.uids != less.uids:
        raise InputError("the rows to compare have not walked the same episodes")
    paired = more.values.mean(0) - less.values.mean(0)
    mean = float(np.nanmean(paired)) if np.isfinite(paired).any() else math.nan
    seeds = _between_seeds(more.values), _between_seeds(less.values)
    scenes = _between_scenes(more, paired)
    half = _half_width([*seeds, scenes])
    return Difference(mean, mean - half, mean + half, seeds, scenes)


def _between_seeds(values: NDArray[np.float64]) -> Variance:
    count = len(values)
    if count < 2:
        return Variance(0.0, 0)
    return Variance(float(np.nanmean(values, 1).var(ddof=1) / count), count - 1)


def _between_scenes(trials: Trials, values: NDArray[np.float64]) -> Variance:
    """Return the variance of the mean of values (N,) over scenes, and paths within them."""
    clustered = clustered_interval(
        values, trials.scenes, trials.trajectories, np.random.default_rng(0)
    )
    error = (clustered.high - clustered.low) / (2 * ndtri((1 + LEVEL) / 2))
    count = len(set(trials.scenes))
    if count < 2:  # one scene: other paths in it
        return Variance(float(error**2), len(set(trials.trajectories)) - 1)
    # A bootstrap variance is that of n values divided by n, not n − 1.
    return Variance(float(error**2 * count / (count - 1)), count - 1)


def _half_width(parts: Sequence[Variance]) -> float:
    """Return half the width of the interval of a sum of independent parts."""
    total = sum(part.value for part in parts)
    spread = sum(part.value**2 / max(part.freedom, 1) for part in parts)
    if spread == 0:
        return 0.0  # nothing varies
    return float(stdtrit(total**2 / spread, (1 + LEVEL) / 2) * math.sqrt(total))


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
    p_value = min(1.0, 2 * float(bdtr(min(len(lost), len(won)), flips, 0.5)))
    return Flips(tuple(lost.tolist()), tuple(won.tolist()), p_value)
