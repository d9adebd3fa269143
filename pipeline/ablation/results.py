"""The results file of an ablation: every walk's metrics, from which tables and claims follow."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...datasets.mixture.comparison import METRICS
from ...evaluation.results import RATES, interval_json, uid_of
from ...evaluation.statistics import Difference, Interval, Trials, difference, mean_over_seeds
from ...formats.core.atomic import write_bytes
from ...formats.core.errors import FileFormatError
from ..engine.work import digest

if TYPE_CHECKING:
    from .cells import CellResult
    from .plan import Ablation

FORMAT = "vlnpe-ablation/1"
RESULTS_NAME = "results.json"
SHOWN, NOT_SHOWN, OPPOSITE, UNMEASURED = (
    "shown",
    "not shown",
    "the opposite is shown",
    "not measured",
)


def results_json(
    ablation: Ablation, cells: Mapping[tuple[str, str, int], CellResult]
) -> dict[str, Any]:
    """Return the content of the results file.

    Args:
        cells: what has been measured so far, by row, test and seed.
    """
    comparison = ablation.comparison
    rows = []
    for row, test in comparison.cells():
        entry: dict[str, Any] = {
            "row": row,
            "test": test,
            "label": comparison.label((row, test)),
            "varies": comparison.rows[row].varies,
            "seeds": {
                str(seed): asdict(cells[row, test, seed])
                for seed in ablation.seeds
                if (row, test, seed) in cells
            },
        }
        if row in ablation.missing:
            entry["missing"] = ablation.missing[row]
        if training := ablation.trainings.get(row):
            config, plan = training.planned.config, training.planned.plan
            entry["training"] = {
                "steps": config.steps,
                "episodes": sum(len(source.selection) for source in plan.sources),
                "data": [source.selection.digest for source in plan.sources],
            }
        rows.append(entry)
    claims = [
        {
            "text": claim.text,
            "metric": claim.metric,
            "more": comparison.label(more),
            "less": comparison.label(less),
        }
        for claim in comparison.claims
        for more, less in comparison.pairs(claim)
    ]
    value = {
        "format": FORMAT,
        "title": ablation.recipe.title,
        "notes": [comparison.note] if comparison.note else [],
        "train": dict(ablation.recipe.train),
        "tests": {name: asdict(test) for name, test in comparison.tests.items()},
        "holdout": {"by": ablation.holdout.by, "scenes": list(ablation.holdout.scenes)},
        "metrics": list(METRICS),
        "episodes": [
            [e.split, e.scene_id, e.trajectory_id, e.episode_id] for e in ablation.episodes
        ],
        "instructions_sha256": digest([e.instruction for e in ablation.episodes]),
        "rows": rows,
        "claims": claims,
    }
    return value | {"judged": [judgement.to_json() for judgement in judge(value)]}


def write_results(out: Path, value: Mapping[str, Any]) -> None:
    """Write the results file, one cell per line."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    write_bytes(out / RESULTS_NAME, (text.replace('},"', '},\n"') + "\n").encode())


def read_results(path: Path) -> dict[str, Any]:
    """Read the results file of an ablation."""
    try:
        value = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise FileFormatError(path, f"not the results of an ablation ({error})") from error
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        raise FileFormatError(path, f"not the results of an ablation; valid: format {FORMAT}")
    return value


def trials(value: Mapping[str, Any], row: Mapping[str, Any], metric: str) -> Trials | None:
    """Return a row's values of a metric, or None if no seed was measured."""
    if not row["seeds"]:
        return None
    column, episodes = value["metrics"].index(metric), value["episodes"]
    values = [[walk[column] for walk in cell["values"]] for cell in row["seeds"].values()]
    return Trials(
        tuple(uid_of(split, scene, episode) for split, scene, _, episode in episodes),
        tuple(scene for _, scene, _, _ in episodes),
        tuple(path for _, _, path, _ in episodes),
        np.array(values, np.float64),
    )


def interval(value: Mapping[str, Any], row: Mapping[str, Any], metric: str) -> Interval | None:
    """Return a row's mean of a metric with its interval, or None if no seed was measured."""
    measured = trials(value, row, metric)
    return None if measured is None else mean_over_seeds(measured, rate=metric in RATES)


@dataclass(frozen=True)
class Judgement:
    """The verdict about a claim, by the interval of its difference.

    Attributes:
        claim: entry of the results file.
        verdict: `shown`, `not shown`, `the opposite is shown`, or `not measured`.
        difference: more minus less; None if not measured.
        seeds: smallest number of seeds of a compared row whose seeds differ; 0 if none does.
        episodes, scenes: walked by both.
    """

    claim: Mapping[str, str]
    verdict: str
    difference: Difference | None
    seeds: int
    episodes: int
    scenes: int

    def to_json(self) -> dict[str, Any]:
        """Return the claim with its verdict and interval as JSON values."""
        interval = None
        if (result := self.difference) is not None:
            interval = interval_json(Interval(result.mean, result.low, result.high))
        return {**self.claim, "verdict": self.verdict, "difference": interval}


def judge(value: Mapping[str, Any]) -> list[Judgement]:
    """Return the judgement of every claim of a results file."""
    rows = {row["label"]: row for row in value["rows"]}
    return [_judgement(value, claim, rows) for claim in value["claims"]]


def _judgement(
    value: Mapping[str, Any], claim: Mapping[str, str], rows: Mapping[str, Mapping[str, Any]]
) -> Judgement:
    pair = [rows[claim["more"]], rows[claim["less"]]]
    more, less = (trials(value, row, claim["metric"]) for row in pair)
    scenes = len({scene for _, scene, _, _ in value["episodes"]})
    counts = [len(row["seeds"]) for row in pair if row["varies"]]
    size = min(counts, default=0), len(value["episodes"]), scenes
    if more is None or less is None:
        return Judgement(claim, UNMEASURED, None, *size)
    result = difference(more, less)
    verdict = NOT_SHOWN
    if result.low > 0:
        verdict = SHOWN
    elif result.high < 0:
        verdict = OPPOSITE
    return Judgement(claim, verdict, result, *size)
