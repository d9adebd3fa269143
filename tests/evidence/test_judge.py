"""Verdicts follow from intervals over seeds and scenes."""

import numpy as np
import pytest

from benchmarks.evidence.judge import (
    CONTRADICTED,
    NOT_SHOWN,
    REPRODUCED,
    SHOWN,
    Walks,
    difference,
    mean_interval,
    verdict,
)
from vlnpe.formats.core.errors import InputError

SCENES = 10
PATHS = 20


def walks(rates: list[float], seed: int = 0, scene_spread: float = 0.0) -> Walks:
    """One success rate per training seed; scenes differ by `scene_spread`."""
    rng = np.random.default_rng(seed)
    easier = rng.normal(0, scene_spread, SCENES).repeat(PATHS)
    p = np.clip(np.array(rates)[:, None] + easier, 0, 1)
    values = np.where(rng.random((len(rates), SCENES * PATHS)) < p, 100.0, 0.0)
    scenes = tuple(f"s{k // PATHS}" for k in range(SCENES * PATHS))
    names = tuple(str(k) for k in range(SCENES * PATHS))
    seeds = tuple(range(len(rates)))
    return Walks(names, scenes, names, {"SR": values, "FR": 0 * values}, seeds)


def judged(more: Walks, less: Walks, metric: str = "SR") -> str:
    return verdict(difference(more, less, metric), published=True)


def test_a_large_difference_is_shown_and_its_reverse_contradicts() -> None:
    good, bad = walks([0.5, 0.52, 0.48]), walks([0.1, 0.12, 0.09], seed=1)
    found = difference(good, bad, "SR")
    assert found.low < 40 < found.high + 8 and verdict(found, published=True) == REPRODUCED
    assert verdict(found, published=False) == SHOWN
    assert verdict(difference(bad, good, "SR"), published=True) == CONTRADICTED


def test_equal_rows_show_nothing() -> None:
    assert judged(walks([0.3] * 3), walks([0.3] * 3, seed=1)) == NOT_SHOWN
    same = walks([0.3] * 3)
    assert judged(same, same, "FR") == NOT_SHOWN  # both zero, without a width


def test_seeds_that_differ_widen_the_interval() -> None:
    """A difference that rests on one lucky training is none."""
    steady = difference(walks([0.4, 0.4, 0.4]), walks([0.2] * 3, seed=1), "SR")
    lucky = difference(walks([0.8, 0.2, 0.2]), walks([0.2] * 3, seed=1), "SR")
    assert verdict(steady, published=True) == REPRODUCED
    assert verdict(lucky, published=True) == NOT_SHOWN
    assert lucky.high - lucky.low > 2 * (steady.high - steady.low)


def test_scenes_that_differ_widen_the_interval() -> None:
    even, uneven = walks([0.4] * 3), walks([0.4] * 3, scene_spread=0.3)
    width = [(f := mean_interval(w, "SR")).high - f.low for w in (even, uneven)]
    assert width[1] > 2 * width[0]


def test_rates_that_never_vary_get_an_exact_interval() -> None:
    found = mean_interval(walks([0.4] * 3), "FR")
    assert found.low == 0 and 1.0 < found.high < 3.0


def test_rows_of_other_episodes_are_not_compared() -> None:
    one, other = walks([0.5] * 2), walks([0.5] * 2)
    moved = Walks(other.uids[::-1], other.scenes, other.trajectories, other.values, other.seeds)
    with pytest.raises(InputError, match="same episodes"):
        difference(one, moved, "SR")
