"""Intervals over seeds and scenes, and what they say about a claim."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from vlnpe.evaluation.results import RATES
from vlnpe.evaluation.statistics import LEVEL, clustered_interval
from vlnpe.formats.core.errors import InputError
from vlnpe.learning.ablation.intervals import Difference, half_width

SHOWN, REPRODUCED = "shown", "reproduced"  # the latter, where VLN-PE reports the same
NOT_SHOWN, CONTRADICTED = "not shown", "contradicted"
UNMEASURED = "not measured"
METRICS = ("SR", "OS", "SPL", "NE", "FR", "StR", "CR")


@dataclass(frozen=True)
class Walks:
    """The episodes of one row under all its seeds.

    Attributes:
        uids: (N,) of the episodes.
        scenes, trajectories: (N,) of each.
        values: by metric (S, N), one row per seed.
        seeds: (S,) of the trainings, or of the policy's draws.
    """

    uids: tuple[str, ...]
    scenes: tuple[str, ...]
    trajectories: tuple[str, ...]
    values: Mapping[str, NDArray[np.float64]]
    seeds: tuple[int, ...]


def mean_interval(walks: Walks, metric: str) -> Difference:
    """Return a metric's mean with its 95 % interval over seeds and scenes; see `difference`."""
    values = walks.values[metric]
    mean = float(np.nanmean(values))
    if metric in RATES and mean in (0.0, 100.0):  # nothing varies: Clopper's and Pearson's
        place = (walks.scenes, walks.trajectories, np.random.default_rng(0))
        exact = clustered_interval(values[0], *place, rate=True)
        return Difference(mean, exact.low, exact.high)
    found = _joined(mean, [_of_seeds(values), _of_scenes(walks, np.nanmean(values, 0))])
    if metric not in RATES:
        return found
    return Difference(mean, max(found.low, 0.0), min(found.high, 100.0))


def difference(more: Walks, less: Walks, metric: str) -> Difference:
    """Return a metric's difference of two rows with its 95 % interval over seeds and scenes.

    Three variances are added, and the width is Student's t with the degrees of freedom of the sum
    (Welch–Satterthwaite): of each row's mean over its seeds, and of the seeds' mean difference over
    scenes and paths (the clustered bootstrap of `evaluation.statistics`), paired by episode. A row
    with one seed says nothing of other seeds, so that the interval does not cover them.

    Raises:
        InputError: The rows did not walk the same episodes.
    """
    if more.uids != less.uids:
        raise InputError("the rows to compare have not walked the same episodes")
    a, b = more.values[metric], less.values[metric]
    paired = a.mean(0) - b.mean(0)
    parts = [_of_seeds(a), _of_seeds(b), _of_scenes(more, paired)]
    return _joined(float(np.nanmean(paired)), parts)


def verdict(found: Difference, *, published: bool) -> str:
    """Return what the interval of a difference says about the claim that it is above zero.

    Args:
        found: the difference.
        published: whether VLN-PE reports the claim.
    """
    if found.low > 0:
        return REPRODUCED if published else SHOWN
    return CONTRADICTED if found.high < 0 else NOT_SHOWN


def _of_seeds(values: NDArray[np.float64]) -> tuple[float, int]:
    """Return the variance of the mean over seeds, and its degrees of freedom."""
    count = len(values)
    if count < 2:
        return 0.0, 1
    return float(np.nanmean(values, 1).var(ddof=1) / count), count - 1


def _of_scenes(walks: Walks, values: NDArray[np.float64]) -> tuple[float, int]:
    """Return the variance of a mean over scenes and paths, and its degrees of freedom."""
    found = clustered_interval(values, walks.scenes, walks.trajectories, np.random.default_rng(0))
    error = (found.high - found.low) / (2 * norm.ppf((1 + LEVEL) / 2))
    count = len(set(walks.scenes))
    if count < 2:  # one scene: other paths in it
        return float(error**2), max(len(set(walks.trajectories)) - 1, 1)
    # A bootstrap variance is that of n values divided by n, not n − 1.
    return float(error**2 * count / (count - 1)), count - 1


def _joined(mean: float, parts: Sequence[tuple[float, int]]) -> Difference:
    variances = np.array([[variance] for variance, _ in parts])
    half = float(half_width(variances, np.array([freedom for _, freedom in parts]))[0])
    return Difference(mean, mean - half, mean + half)
