"""The ablation's page from made-up scores: its verdicts, words, intervals and width."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.support.browser import hidden_px
from vlnpe.datasets.mixture.recipe import recipe_of
from vlnpe.learning.ablation.evaluate import EpisodeScore
from vlnpe.learning.ablation.page import plot_png, report_html
from vlnpe.learning.ablation.report import differences, estimates, report_markdown
from vlnpe.learning.ablation.run import Ablation, Row
from vlnpe.learning.config import train_config
from vlnpe.learning.training.holdout import Holdout

ROBOTS = ["humanoid", "small_humanoid", "quadruped", "wheeled_robot", "vlnce_style"]
LONG = "three robots and the VLN-CE-style agent together"


class Held:
    """As much of a selection as the report asks for."""

    def __init__(self, names: list[str]):
        self.names = np.array(names)

    def __len__(self) -> int:
        return len(self.names)

    def trajectories(self) -> Any:
        return self.names


def run(names: list[str], part: float, frames: int = 1000) -> list[EpisodeScore]:
    right = round(part * frames)
    return [EpisodeScore(name, frames, right, 99.0, frames, 100, 60, 900, 700) for name in names]


def ablation(
    trajectories: int = 1,
    seeds: int = 3,
    fitted: float = 0.7,
    fit_constant: float = 0.5,
    reached: dict[str, float] | None = None,
    episodes: int = 12,
) -> Ablation:
    robots = ROBOTS if reached is None else list(reached)
    part = reached or dict.fromkeys(robots, 0.55)
    names = [f"house/{n}" for n in range(trajectories)]
    rng = np.random.default_rng(0)

    def row(extra: float) -> Row:
        plan: Any = SimpleNamespace(sources=[SimpleNamespace(selection=range(episodes))])
        scores = {
            robot: [
                [
                    s
                    for name in names
                    for s in run([name], part[robot] + extra + rng.normal(0, 0.01))
                ]
                for _ in range(seeds)
            ]
            for robot in robots
        }
        seen = [run(["house/x"], fitted) for _ in range(seeds)]
        return Row(plan, scores, seen, run(["house/x"], fit_constant))

    recipe = recipe_of(
        {
            "recipe": 1,
            "title": "Which robot's data helps?",
            "sources": {robot: {"robots": [robot]} for robot in robots},
            "mixtures": {"alone": robots[:1], LONG: robots},
            "compare": [[LONG, "alone"]],
        }
    )
    held: Any = {robot: Held(names) for robot in robots}
    return Ablation(
        recipe,
        train_config({"seeds": seeds, "steps": 1, "batch": 1}),
        Holdout("scene", ("house",), frozenset(names)),
        held,
        {"alone": row(0.0), LONG: row(0.001)},
        {robot: run(names, 0.5) for robot in robots},
        {robot: run(names, 0.5) for robot in robots},
    )


@pytest.mark.parametrize(("fitted", "fits"), [(0.74, False), (0.75, True), (0.9, True)])
def test_a_row_has_the_same_verdict_of_fit_on_every_robot(fitted: float, fits: bool) -> None:
    # On one robot it is as good as on what it has seen, on the other much worse.
    found = ablation(fitted=fitted, reached={"h1": 0.59, "jetbot": 0.41})
    report = report_markdown(found, "plot.png")
    verdicts = [line for line in report.splitlines() if line.startswith("The best row")]
    assert len(verdicts) == 2
    for line in verdicts:
        assert ("fits what it has seen" in line) == ("collect more" in line) == fits
        assert ("raise steps" in line) != fits
    rows = [line for line in report.splitlines() if line.startswith(("| alone |", f"| {LONG} |"))]
    assert sum(line.endswith(f"| {'yes' if fits else 'no'} |") for line in rows) == 2
    assert not any(line.endswith(f"| {'no' if fits else 'yes'} |") for line in rows)


def test_counts_of_one_are_singular() -> None:
    report = report_markdown(ablation(episodes=1, fitted=0.9), "plot.png")
    assert "1 trajectory in 1 scene" in report and "humanoid: 1 episode of 1 trajectory" in report
    assert "of 1 step of 1 episode" in report and "1 episode is too few" in report
    assert "a whole scene (house)" in report
    assert not re.search(r"\b1 (trajectories|scenes|episodes|steps|trainings|seeds)\b", report)
    assert "1 training of" in report_markdown(ablation(seeds=1), "plot.png")
    assert "3 trajectories in 1 scene" in report_markdown(ablation(trajectories=3), "plot.png")


def test_a_missing_interval_is_explained() -> None:
    one = report_markdown(ablation(trajectories=1), "plot.png")
    assert f"On {', '.join(ROBOTS)}: no interval, because one held-out trajectory cannot" in one
    assert "Welch" not in one and "…" not in one
    training = report_markdown(ablation(trajectories=9, seeds=1), "plot.png")
    assert "no interval, because one training per row" in training and "±" not in training
    both = report_markdown(ablation(trajectories=1, seeds=1), "plot.png")
    assert "one held-out trajectory cannot" in both and "and one training per row" in both


@pytest.mark.parametrize("trajectories", [2, 3, 9])
def test_few_trajectories_have_an_interval_and_a_caution(trajectories: int) -> None:
    found = ablation(trajectories=trajectories)
    report = report_markdown(found, "plot.png")
    for entry in differences(found):
        action = entry["difference"]["action"]
        assert action.low < action.mean < action.high
    assert "Welch" in report
    caution = f"the intervals rest on {trajectories} held-out trajectories only"
    assert (caution in report) == (trajectories < 6)


def test_the_page_shows_the_picture_and_the_tables_and_escapes_names() -> None:
    markdown = "# a <b>\n\n![Plot](plot.png)\n\n| row | x |\n| --- | ---: |\n| <i> | **+1** |\n"
    page = report_html(markdown, "plot.png", b"ABC")
    assert "<h1>a &lt;b&gt;</h1>" in page
    assert '<img src="data:image/png;base64,QUJD" alt="Plot" />' in page
    assert "<td>&lt;i&gt;</td>" in page
    assert '<td style="text-align:right"><strong>+1</strong></td>' in page


@pytest.mark.parametrize("trajectories", [1, 3])
def test_nothing_is_cut_off_at_1200_px(trajectories: int, tmp_path: Path) -> None:
    found = ablation(trajectories=trajectories)
    picture = plot_png(estimates(found), found.recipe.title)
    page = report_html(report_markdown(found, "plot.png"), "plot.png", picture)
    hidden = hidden_px(page, ".wide", 1200, tmp_path)
    assert len(hidden) == 1 + len(ROBOTS) + 2  # the page, its tables
    assert max(hidden) <= 0
