"""An ablation as tables: Markdown for people, JSON for programs."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...datasets.mixture.table import plan_json
from ..training.holdout import scene_of
from .evaluate import EpisodeScore, Summary
from .fit import training_fit
from .intervals import Difference, Estimate, caution, over_seeds, paired_differences
from .run import Ablation, Row

MARGIN = 0.10  # by which an agent must beat the commonest action to have learned something
CONSTANT, REPEAT = "best constant", "repeat the step before"
_TITLES = {"action": "action", "waypoint_m": "waypoints", "stop": "stop"}


def estimates(ablation: Ablation) -> dict[str, dict[str, dict[str, Estimate]]]:
    """Return the mean and interval by row, evaluated source and metric; baselines first."""
    result: dict[str, dict[str, dict[str, Estimate]]] = {}
    for name, baseline in ((CONSTANT, ablation.constant), (REPEAT, ablation.repeat)):
        result[name] = {where: _estimate([run]) for where, run in baseline.items()}
    for name, row in ablation.rows.items():
        result[name] = {where: _estimate(runs) for where, runs in row.scores.items()}
    return result


def differences(ablation: Ablation) -> list[dict[str, Any]]:
    """Return the comparisons of the recipe, by evaluated source."""
    result = []
    for ours, theirs in ablation.recipe.compare:
        for where in ablation.held:
            rng = np.random.default_rng([ablation.recipe.seed, len(result)])
            found = paired_differences(
                ablation.rows[ours].scores[where], ablation.rows[theirs].scores[where], rng
            )
            result.append({"with": ours, "without": theirs, "on": where, "difference": found})
    return result


def report_json(ablation: Ablation) -> dict[str, Any]:
    """Return the whole ablation as JSON values; NaN is null."""

    def estimate(value: Estimate) -> dict[str, float | None]:
        return {"mean": value.mean, "half": _or_none(value.half)}

    return {
        "title": ablation.recipe.title,
        "interval": "95 %: Student's t over seeds; differences: Welch's t over seeds and "
        "bootstrapped held-out trajectories",
        "holdout": {
            "by": ablation.holdout.by,
            "scenes": list(ablation.holdout.scenes),
            "trajectories": sorted(ablation.holdout.trajectories),
        },
        "train": ablation.config.to_json(),
        "rows": {
            name: {
                where: {metric: estimate(v) for metric, v in metrics.items()}
                for where, metrics in row.items()
            }
            for name, row in estimates(ablation).items()
        },
        "differences": [
            {
                **entry,
                "caution": caution(
                    ablation.config.seeds, _held_trajectories(ablation, entry["on"])
                ),
                "difference": {
                    metric: {k: _or_none(v) for k, v in vars(difference).items()}
                    for metric, difference in entry["difference"].items()
                },
            }
            for entry in differences(ablation)
        ],
        "training_fit": {
            name: {"action": estimate(fit.action), "constant": fit.constant, "fits": fit.fits}
            for name, row in ablation.rows.items()
            for fit in [training_fit(row)]
        },
        "mixtures": [plan_json(row.plan) for row in ablation.rows.values()],
    }


def report_markdown(ablation: Ablation, plot: str) -> str:
    """Return the report; `plot` is the file name of the plot."""
    lines = [f"# {ablation.recipe.title or 'Ablation'}", "", *_setting(ablation), ""]
    lines += [f"![Held-out action accuracy by training data]({plot})", ""]
    found = estimates(ablation)
    for where in ablation.held:
        lines += [f"## Tested on {where}", "", *_table(ablation, found, where), ""]
        lines += [_verdict(ablation, found, where), ""]
    lines += ["## Training fit", "", *_fits(ablation), ""]
    if ablation.recipe.compare:
        lines += ["## Differences", "", *_comparisons(ablation), ""]
    return "\n".join(lines)


def _counted(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def _held_trajectories(ablation: Ablation, where: str) -> int:
    return len(set(ablation.held[where].trajectories().tolist()))


def _setting(ablation: Ablation) -> list[str]:
    config, holdout = ablation.config, ablation.holdout
    held = "; ".join(
        f"{name}: {_counted(len(selection), 'episode')} of "
        f"{_counted(_held_trajectories(ablation, name), 'trajectory', 'trajectories')}"
        for name, selection in ablation.held.items()
    )
    many = len(holdout.scenes) > 1
    what = {
        "scene": f"{'whole scenes' if many else 'a whole scene'} ({', '.join(holdout.scenes)})",
        "split": "the published val and test splits of the episodes' source",
        "trajectory": "trajectories of scenes that training knows",
    }[holdout.by]
    trajectories = _counted(len(holdout.trajectories), "trajectory", "trajectories")
    scenes = _counted(len({scene_of(t) for t in holdout.trajectories}), "scene")
    return [
        f"Held out: {what}; {trajectories} in {scenes}, which no row has seen by any robot. "
        f"Predicted: {held}.",
        "",
        f"Every row: {_counted(config.seeds, 'training')} of {_counted(config.steps, 'step')} of "
        f"{_counted(config.batch, 'episode')}, images of {config.size_px} px, whatever its amount "
        "of data. "
        "Predicted step by step with the true steps before (teacher forcing), so these are no "
        "success rates. Action: part of the steps whose action (of 4) is right. Waypoints: mean "
        "distance of the next 8 poses. Stop: mean of the parts of the steps within 4 steps of "
        "the end, and of the others, that are recognised; 50 % is chance.",
        "",
        f"± is Student's t-interval at 95 % over {config.seeds} seeds: how much trainings vary, "
        "not trajectories or scenes."
        if config.seeds > 1
        else "No row has an interval: one training does not show how much trainings vary.",
    ]


def _table(ablation: Ablation, found: Mapping[str, Any], where: str) -> list[str]:
    head = ["trained on", "episodes", *_TITLES.values()]
    lines = ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1)]
    for name, row in found.items():
        trained = ablation.rows.get(name)
        count = str(_episodes(trained)) if trained else "–"
        cells = [_cell(metric, row[where][metric]) for metric in _TITLES]
        lines.append("| " + " | ".join([name, count, *cells]) + " |")
    return lines


def _verdict(ablation: Ablation, found: Mapping[str, Any], where: str) -> str:
    """Return which rows beat the commonest action by enough, and if none does, what to do."""
    constant = found[CONSTANT][where]["action"].mean
    gains = {name: found[name][where]["action"].mean - constant for name in ablation.rows}
    best = max(gains, key=lambda name: gains[name])
    text = (
        f"The best row ({best}) is {100 * gains[best]:+.1f} points from the commonest action "
        f"({100 * constant:.1f} %)"
    )
    if gains[best] >= MARGIN:
        short = [name for name, gain in gains.items() if gain < MARGIN]
        return f"{text}; asked for: at least +10. " + (
            f"Not reached by: {', '.join(short)}." if short else "Every row reaches it."
        )
    text += ", short of the +10 asked for."
    left = 1 - constant
    if left < 2 * MARGIN:
        text += (
            f" All other actions are only {100 * left:.1f} % of the steps, so +10 would be most of "
            "what can be gained."
        )
    row = ablation.rows[best]
    if training_fit(row).fits:
        few = "is" if _episodes(row) == 1 else "are"
        amount = f"{_counted(_episodes(row), 'episode')} {few} too few to carry over"
        return f"{text} It fits what it has seen (below), and {amount}: collect more."
    return f"{text} It does not even fit what it has seen (below): raise steps or model sizes."


def _episodes(row: Row) -> int:
    return sum(len(source.selection) for source in row.plan.sources)


def _fits(ablation: Ablation) -> list[str]:
    lines = [
        "On some of its own training episodes, a row that fits makes at most half of the errors "
        "that always taking the commonest action makes. This does not depend on what it is tested "
        "on. A row that does not fit is trained too briefly or too small.",
        "",
        "| trained on | training actions right | commonest action | fits |",
        "| --- | ---: | ---: | --- |",
    ]
    for name, row in ablation.rows.items():
        fit = training_fit(row)
        cells = [_cell("action", fit.action), f"{100 * fit.constant:.1f} %"]
        lines.append("| " + " | ".join([name, *cells, "yes" if fit.fits else "no"]) + " |")
    return lines


def _comparisons(ablation: Ablation) -> list[str]:
    entries = differences(ablation)
    lines = []
    if any(not math.isnan(d.low) for entry in entries for d in entry["difference"].values()):
        lines += [
            "Interval: Welch's t at 95 %, over seeds and over bootstrapped held-out trajectories, "
            "the same trajectories for both rows. It is of these held-out scenes; other scenes "
            "vary more. Bold: 0 is outside; of many numbers some are so by chance.",
            "",
        ]
    doubts: dict[str, list[str]] = {}
    for where in ablation.held:
        doubt = caution(ablation.config.seeds, _held_trajectories(ablation, where))
        doubts.setdefault(doubt, []).append(where)
    for doubt, places in doubts.items():
        if doubt:
            lines += [f"On {', '.join(places)}: {doubt}", ""]
    lines += [
        "| with − without | on | action, points | waypoints, m | stop, points |",
        "| --- | --- | ---: | ---: | ---: |",
    ]
    for entry in entries:
        found: Mapping[str, Difference] = entry["difference"]
        cells = [
            _span(found["action"], 100, 1),
            _span(found["waypoint_m"], 1, 3),
            _span(found["stop"], 100, 1),
        ]
        who = f"{entry['with']} − {entry['without']}"
        lines.append("| " + " | ".join([who, entry["on"], *cells]) + " |")
    return lines


def _estimate(runs: Sequence[list[EpisodeScore]]) -> dict[str, Estimate]:
    summaries = [Summary.of(run) for run in runs]
    return {metric: over_seeds([getattr(s, metric) for s in summaries]) for metric in _TITLES}


def _cell(metric: str, value: Estimate) -> str:
    scale, digits, unit = (1, 3, " m") if metric == "waypoint_m" else (100, 1, " %")
    text = f"{scale * value.mean:.{digits}f}"
    if not math.isnan(value.half):
        text += f" ± {scale * value.half:.{digits}f}"
    return text + unit


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _span(value: Difference, scale: float, digits: int) -> str:
    if math.isnan(value.low):
        return f"{scale * value.mean:+.{digits}f}"
    low, high = scale * value.low, scale * value.high
    mark = "**" if low > 0 or high < 0 else ""
    return f"{mark}{scale * value.mean:+.{digits}f}{mark} ({low:+.{digits}f} … {high:+.{digits}f})"
