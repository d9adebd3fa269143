"""Intervals that cover what they say, and the test of paired successes."""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from vlnpe.evaluation.results import COLUMNS, results_json, table
from vlnpe.evaluation.statistics import (
    Trials,
    clustered_interval,
    difference,
    mcnemar,
    mean_over_seeds,
)
from vlnpe.formats.core.errors import InputError
from vlnpe.pipeline.cli import main


def test_scenes_that_differ_widen_the_interval() -> None:
    rng = np.random.default_rng(3)
    covered, covered_flat, trials = 0, 0, 150
    for _ in range(trials):
        scene = rng.normal(0.0, 1.0, 12)
        values = (scene[:, None] + rng.normal(0.0, 0.5, (12, 8))).ravel()
        scenes = [str(s) for s in np.repeat(np.arange(12), 8)]
        paths = [str(k) for k in range(96)]
        interval = clustered_interval(values, scenes, paths, rng, resamples=300)
        flat = clustered_interval(values, ["one"] * 96, paths, rng, resamples=300)
        covered += interval.low <= 0.0 <= interval.high
        covered_flat += flat.low <= 0.0 <= flat.high
    # 95 % is asked; with twelve scenes a percentile bootstrap gives a little less.
    assert 0.86 <= covered / trials <= 1.0
    assert covered_flat / trials < 0.75


def test_instructions_of_one_path_are_no_further_evidence() -> None:
    rng = np.random.default_rng(1)
    paths = [str(k) for k in range(10)]
    values = rng.normal(size=10)
    one = clustered_interval(values, ["s"] * 10, paths, np.random.default_rng(0))
    three = clustered_interval(
        np.repeat(values, 3), ["s"] * 30, np.repeat(paths, 3).tolist(), np.random.default_rng(0)
    )
    assert (three.low, three.high) == pytest.approx((one.low, one.high))


def test_rates_of_none_or_all_keep_an_interval() -> None:
    rng = np.random.default_rng(0)
    paths = [str(k) for k in range(6)]
    none = clustered_interval([0.0] * 6, ["s"] * 6, paths, rng, rate=True)
    every = clustered_interval([100.0] * 6, ["s"] * 6, paths, rng, rate=True)
    # 1 - 0.025 ** (1 / 6), Clopper and Pearson's bound for none of six.
    assert (none.low, none.high) == pytest.approx((0.0, 45.93), abs=0.01)
    assert (every.low, every.high) == pytest.approx((54.07, 100.0), abs=0.01)


def test_rates_of_few_paths_have_the_exact_interval() -> None:
    def interval(values: list[float], paths: str) -> tuple[float, float]:
        rng = np.random.default_rng(0)
        found = clustered_interval(values, ["s"] * len(values), list(paths), rng, rate=True)
        return found.low, found.high

    exact = binomtest(3, 4).proportion_ci(0.95)
    expected = pytest.approx((100 * exact.low, 100 * exact.high))
    assert interval([100.0, 0.0, 100.0, 100.0], "abcd") == expected
    # Two texts of each path are no further evidence.
    assert interval([100.0, 100.0, 0.0, 0.0, *[100.0] * 4], "aabbccdd") == expected
    # Texts of one path that end differently: wider than that of either whole number of successes.
    low, high = interval([100.0, 0.0, 100.0, 100.0], "aabb")
    assert binomtest(1, 2).proportion_ci(0.95).low < low / 100 < 0.25 and high < 100.0
    assert all(math.isnan(bound) for bound in interval([91.0, 0.0, 88.0, 100.0], "abcd"))  # SPL


def test_what_is_not_finite_is_left_out() -> None:
    rng = np.random.default_rng(0)
    found = clustered_interval([1.0, math.inf, math.nan], ["s"] * 3, ["a", "b", "c"], rng)
    assert found.mean == 1.0 and math.isnan(found.low)
    assert math.isnan(clustered_interval([], [], [], rng).mean)


@pytest.mark.parametrize(("paths", "told"), [(5, False), (6, True)])
def test_few_paths_get_no_bootstrap_interval(paths: int, told: bool) -> None:
    values = [float(k) for k in range(paths)]
    names = [str(k) for k in range(paths)]
    found = clustered_interval(values, ["s"] * paths, names, np.random.default_rng(0))
    assert found.mean == np.mean(values) and math.isfinite(found.low) == told


def test_mcnemar_counts_flips() -> None:
    a = [True] * 10 + [False] * 10
    b = [True] * 2 + [False] * 8 + [False] * 9 + [True]
    flips = mcnemar(a, b)
    assert flips.lost == tuple(range(2, 10)) and flips.won == (19,)
    assert flips.p_value == pytest.approx(2 * (1 + 9) / 2**9)
    assert mcnemar(a, a).p_value == 1.0


def test_a_table_of_many_groups_fits_a_terminal() -> None:
    metrics = {
        "trajectory_length_m": 11.25,
        "navigation_error_m": 7.5,
        "spl": 0.5,
        "ndtw": 0.25,
        "duration_s": 123.4,
    } | dict.fromkeys(("fall", "stuck", "oracle_success", "success"), True)
    made = [
        {"metrics": metrics, "contacts": 0, "scene": f"s{k % 3}", "trajectory": str(k)}
        for k in range(6)
    ]
    text = table({f"val_unseen_{k}": made for k in range(9)})
    assert max(map(len, text.splitlines())) <= 120
    assert all(f"val_unseen_{k}" in text for k in range(9))
    for name, (unit, _) in COLUMNS.items():
        assert f"{name} [{unit}]" in text
    rows = {line.split()[0]: line.split() for line in table({"all": made}).splitlines()}
    assert rows["NE"] == ["NE", "[m]", "7.50", "(7.50..7.50)"]
    assert rows["TL"] == ["TL", "[m]", "11.25", "(11.25..11.25)"]
    assert rows["SPL"][2:] == ["50.0", "(50.0..50.0)"] and rows["nDTW"][2] == "25.0"
    far = [one | {"metrics": metrics | {"navigation_error_m": 27.5, "ndtw": 0.05}} for one in made]
    rows = {line.split()[0]: line.split() for line in table({"all": far}).splitlines()}
    assert rows["NE"][2] == "27.50" and rows["nDTW"][2] == "5.0"  # as if they were near 20


def test_results_are_summed_up_per_split_and_scene() -> None:
    metrics = dict.fromkeys(
        ("trajectory_length_m", "navigation_error_m", "duration_s", "spl", "ndtw"), 1.0
    ) | dict.fromkeys(("fall", "stuck", "oracle_success"), False)
    made = [
        {"metrics": metrics | {"success": k < 2}, "contacts": 0, "scene": f"s{k % 2}"}
        | {"split": f"val_{k // 3}", "trajectory": str(k)}
        for k in range(6)
    ]
    value = results_json({}, made, {})
    assert value["summary"]["SR"]["mean"] == pytest.approx(100 / 3)
    assert {k: v["SR"]["mean"] for k, v in value["splits"].items()} == {
        "val_0": pytest.approx(200 / 3),
        "val_1": 0.0,
    }
    assert {k: v["SR"]["mean"] for k, v in value["scenes"].items()} == {
        "s0": pytest.approx(100 / 3),
        "s1": pytest.approx(100 / 3),
    }


SCENES, PATHS = 10, 20


def trials(rates: list[float], seed: int = 0, scene_spread: float = 0.0) -> Trials:
    """One success rate per training seed; scenes differ by `scene_spread`."""
    rng = np.random.default_rng(seed)
    easier = rng.normal(0, scene_spread, SCENES).repeat(PATHS)
    p = np.clip(np.array(rates)[:, None] + easier, 0, 1)
    values = np.where(rng.random((len(rates), SCENES * PATHS)) < p, 100.0, 0.0)
    scenes = tuple(f"s{k // PATHS}" for k in range(SCENES * PATHS))
    names = tuple(str(k) for k in range(SCENES * PATHS))
    return Trials(names, scenes, names, values)


def test_seeds_that_differ_widen_the_interval_of_a_difference() -> None:
    """A difference that rests on one lucky training is none."""
    others = trials([0.2] * 3, seed=1)
    steady, lucky = (
        difference(trials([0.4] * 3), others),
        difference(trials([0.8, 0.2, 0.2]), others),
    )
    assert steady.low > 0 > lucky.low
    assert lucky.half_width > 2 * steady.half_width and lucky.seeds_share > 0.9
    same = trials([0.3] * 3)
    assert (found := difference(same, same)).mean == 0 and found.half_width < steady.half_width


def test_scenes_that_differ_widen_the_interval_over_seeds() -> None:
    even, uneven = trials([0.4] * 3), trials([0.4] * 3, scene_spread=0.3)
    width = [(f := mean_over_seeds(t, rate=True)).high - f.low for t in (even, uneven)]
    assert width[1] > 2 * width[0]


def test_rates_that_never_vary_get_an_exact_interval_over_seeds() -> None:
    found = mean_over_seeds(trials([0.0] * 3), rate=True)
    assert found.low == 0 and 1.0 < found.high < 3.0


def test_policies_that_walked_other_episodes_are_not_compared() -> None:
    one, other = trials([0.5] * 2), trials([0.5] * 2)
    moved = Trials(other.uids[::-1], other.scenes, other.trajectories, other.values)
    with pytest.raises(InputError, match="same episodes"):
        difference(one, moved)


def test_walks_without_a_result_are_left_out_of_pairs() -> None:
    one, other = trials([0.5] * 2), trials([0.2] * 2, seed=1)
    values = one.values.copy()
    values[0, :40] = np.nan
    found = difference(Trials(one.uids, one.scenes, one.trajectories, values), other)
    expected = (one.values.mean(0) - other.values.mean(0))[40:].mean()
    assert found.mean == pytest.approx(expected) and math.isfinite(found.low)


def test_the_number_of_samples_that_would_show_a_difference_does_so() -> None:
    """Simulated: with k times the seeds and scenes, the interval is as narrow as expected_row."""
    found = difference(trials([0.4, 0.45, 0.35], scene_spread=0.1), trials([0.4] * 3, seed=1))
    target = found.half_width / 2
    factor = found.factor_to_show(target)
    assert factor in (2, 3, 4) and found.factor_to_show(found.half_width) == 1
    assert found.factor_to_show(0.0) is None


@pytest.mark.parametrize(("of_seeds", "of_paths"), [(3.0, 0.5), (0.5, 10.0), (2.0, 6.0)])
def test_intervals_of_differences_hold_the_truth_as_often_as_they_say(
    of_seeds: float, of_paths: float
) -> None:
    rng = np.random.default_rng(5)
    truth, repeats, paths, seeds = 2.0, 150, 16, 3
    names = tuple(map(str, range(paths)))

    def walked(gain: np.ndarray) -> Trials:
        return Trials(names, names, names, gain + rng.normal(0, of_seeds, (seeds, 1)))

    held = 0
    for _ in range(repeats):
        hard = rng.normal(0, 10.0, paths)  # for both
        more = walked(hard + truth + rng.normal(0, of_paths, paths))
        found = difference(more, walked(hard))
        held += found.low <= truth <= found.high
    assert held / repeats >= 0.9


METRICS = dict.fromkeys(
    ("trajectory_length_m", "navigation_error_m", "duration_s", "ndtw", "spl"), 1.0
) | dict.fromkeys(("fall", "stuck", "oracle_success", "success"), False)
EPISODE = {"split": "val", "scene": "s", "episode": "1", "trajectory": "t", "contacts": 0}
EPISODE |= {"metrics": METRICS}


def metric(**changes: Any) -> dict[str, Any]:
    return EPISODE | {"metrics": METRICS | changes}


@pytest.mark.parametrize(
    ("episodes", "said"),
    [
        ([{}], "split is None"),
        ([3], "episode number 0 is 3"),
        ([EPISODE | {"metrics": None}], "number 0: TL cannot be read"),
        ([EPISODE | {"metrics": []}], "TL cannot be read"),
        ([EPISODE | {"metrics": {}}], "lacks 'trajectory_length_m', which TL needs"),
        ([metric(success="yes")], "SR cannot be read .'yes' is no number"),
        ([metric(spl="0.5")], "SPL cannot be read"),
        ([metric(ndtw="0.5")], "nDTW cannot be read"),
        ([metric(navigation_error_m=[1])], "NE cannot be read"),
        ([metric(spl=float("nan"))], "SPL cannot be read"),
        ([metric(spl=1e300)], "valid: 0 to 1"),
        ([metric(duration_s={})], "time cannot be read"),
        ([metric(fall=10**400)], "FR cannot be read"),
        ([metric(duration_s=10**400)], "time cannot be read"),
        ([{k: v for k, v in EPISODE.items() if k != "contacts"}], "lacks 'contacts'"),
        ([EPISODE | {"scene": ["s"]}], "scene is"),
        ([EPISODE | {"trajectory": {}}], "trajectory is"),
        ([EPISODE, EPISODE], "val/s/1 occurs twice"),
        ({}, "not results"),
    ],
)
def test_compare_names_what_it_cannot_read_in_one_line(
    episodes: object, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, value in (("good", [EPISODE]), ("bad", episodes)):
        (tmp_path / name).mkdir()
        content = {"format": "vlnpe-results/1", "setting": {}, "episodes": value}
        (tmp_path / name / "results.json").write_text(json.dumps(content))
    assert main(["compare", str(tmp_path / "good"), str(tmp_path / "bad")]) == 2
    line = capfd.readouterr().err
    assert re.search(said, line) and str(tmp_path / "bad") in line and line.count("\n") == 1


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "[{}]", "3", '{"setting": 3}', "\ufeff{}"])
def test_compare_refuses_other_files(
    text: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "results.json").write_text(text)
    assert main(["compare", str(tmp_path), str(tmp_path)]) == 2
    assert capfd.readouterr().err.count("\n") == 1
