"""The published results belong to their recipes, and the page says what they hold."""

import itertools
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.evidence.__main__ import HERE, RECIPES, main
from vlnpe.datasets.mixture.recipe import read_recipe
from vlnpe.evaluation.results import by_uid, compare, decimals, summarise
from vlnpe.evaluation.statistics import Interval
from vlnpe.learning.config import train_config
from vlnpe.pipeline.ablation.page import figure_svg, markdown
from vlnpe.pipeline.ablation.results import interval, judge, read_results

# Results of `vlnpe evaluate`, by name.
EVALUATIONS = ("dagger", "ceiling", "kinds", "robots", "senses", "limits", "homes", "adapt")
RESULTS = sorted(p.stem for p in (HERE / "results").glob("*.json") if p.stem not in EVALUATIONS)
# Episodes of the results that have other than 204; their recipe asks for 48.
SHORTAGE = {"pretrained": 40, "pretrained-small_house": 47}
DATA = Path(__file__).resolve().parents[2] / "docs" / "results" / "data.md"


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    return {name: read_results(HERE / "results" / f"{name}.json") for name in RESULTS}


def texts(svg: bytes) -> list[str]:
    """Return the labels of a figure; positions may differ by rounding."""
    return [node.text for node in ElementTree.fromstring(svg).iter() if node.text]


@pytest.mark.parametrize("name", RESULTS)
def test_results_have_the_rows_tests_and_claims_of_their_recipe(
    name: str, results: dict[str, Any]
) -> None:
    # `RECIPE-PLACE`: the same trainings in another place.
    recipe, value = read_recipe(RECIPES[name.partition("-")[0]]), results[name]
    comparison, walks = recipe.comparison, len(value["episodes"])
    assert comparison is not None and comparison.walks == (48 if name in SHORTAGE else 204)
    assert walks == SHORTAGE.get(name, 204)
    rows = {(row["row"], row["test"]): row for row in value["rows"]}
    assert set(rows) == set(comparison.cells())
    for row, test in comparison.cells():
        config = train_config({**recipe.train, **comparison.rows[row].train})
        assert rows[row, test].get("training", {"steps": config.steps})["steps"] == config.steps
        for cell in rows[row, test]["seeds"].values():
            assert np.array(cell["values"]).shape == (walks, len(value["metrics"]))
    claims = {
        (claim.text, claim.metric, comparison.label(more), comparison.label(less))
        for claim in comparison.claims
        for more, less in comparison.pairs(claim)
    }
    assert claims == {(c["text"], c["metric"], c["more"], c["less"]) for c in value["claims"]}


def test_the_page_of_results_says_what_the_files_hold(results: dict[str, Any]) -> None:
    def shown(metric: str, found: Interval, sign: str) -> str:
        d = decimals(metric)
        return f"{found.mean:{sign}.{d}f} ({found.low:{sign}.{d}f} … {found.high:{sign}.{d}f})"

    measured = set()
    for name, value in results.items():
        # A stopping rule left rows of these out.
        may_lack = name in SHORTAGE
        for judgement in judge(value):
            assert judgement.difference is not None or may_lack
            if judgement.difference is not None:
                measured.add(shown(judgement.claim["metric"], judgement.difference, "+"))
        for row in value["rows"]:
            for metric in value["metrics"]:
                mean = interval(value, row, metric)
                assert mean is not None or may_lack
                if mean is not None:
                    measured.add(shown(metric, mean, ""))
    for name in EVALUATIONS:
        walks = json.loads((HERE / "results" / f"{name}.json").read_text())
        for first, second in itertools.permutations(walks, 2):
            if not by_uid(walks[first]["episodes"]).keys() & by_uid(walks[second]["episodes"]):
                continue
            changes = compare(walks[first], walks[second], (first, second)).differences
            measured |= {shown(metric, change, "+") for metric, change in changes.items()}
        for value in walks.values():
            means = summarise(value["episodes"]).items()
            measured |= {shown(metric, mean, "") for metric, mean in means}
    page = DATA.read_text()
    numbers = re.findall(r"[+−]?[\d.]+ \([^()]* … [^()]*\)", page.replace("\n", " "))
    assert len(numbers) > 60
    assert [number for number in numbers if number.replace("−", "-") not in measured] == []
    figures = re.findall(r"!\[.*\]\((\w+)-rates\.svg\)", page)
    assert len(figures) == 2
    for name in figures:
        svg = DATA.with_name(f"{name}-rates.svg").read_bytes()
        assert texts(svg) == texts(figure_svg(results[name]))


def test_published_results_are_drawn_without_measuring(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], results: dict[str, Any]
) -> None:
    assert main(["scan", "--draw", "--out", str(tmp_path)]) == 0
    report = (tmp_path / "scan" / "report.md").read_text()
    assert report == markdown(results["scan"])
    assert "Scanned homes train better than exact ones: not shown" in report
    assert "-0.8 (-10.2 … +8.6) points" in report and "4.7 would need about 12 seeds" in report
    page = (tmp_path / "scan" / "report.html").read_text()
    assert "data:image/svg+xml" in page and 'src="http' not in page
    assert main(["scans", "--draw"]) == 2
    assert "unknown recipe 'scans' (did you mean scan?)" in capsys.readouterr().err
