"""An ablation as a table: Markdown for people, JSON for programs, one HTML page with the plot."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..mixture.table import plan_json
from .evaluate import EpisodeScore, Summary
from .holdout import scene_of
from .intervals import Difference, Estimate, over_seeds, paired_differences
from .run import Ablation, Row

MARGIN = 0.10  # by which an agent must beat the commonest action to have learned something
CONSTANT, REPEAT = "best constant", "repeat the step before"
_TITLES = {"action": "action", "waypoint_m": "waypoints", "stop": "stop"}


def estimates(ablation: Ablation) -> dict[str, dict[str, dict[str, Estimate]]]:
    """Mean and interval by row, evaluated source and metric; baselines first."""
    result: dict[str, dict[str, dict[str, Estimate]]] = {}
    for name, baseline in ((CONSTANT, ablation.constant), (REPEAT, ablation.repeat)):
        result[name] = {where: _estimate([run]) for where, run in baseline.items()}
    for name, row in ablation.rows.items():
        result[name] = {where: _estimate(runs) for where, runs in row.scores.items()}
    return result


def differences(ablation: Ablation) -> list[dict[str, Any]]:
    """What the recipe asks to compare, by evaluated source."""
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
    """Everything as JSON values; NaN is null."""

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
                "difference": {
                    metric: {k: _or_none(v) for k, v in vars(difference).items()}
                    for metric, difference in entry["difference"].items()
                },
            }
            for entry in differences(ablation)
        ],
        "mixtures": [plan_json(row.plan) for row in ablation.rows.values()],
    }


def report_markdown(ablation: Ablation, plot: str) -> str:
    """The report; `plot` is the picture's file name."""
    lines = [f"# {ablation.recipe.title or 'Ablation'}", "", *_setting(ablation), ""]
    lines += [f"![Held-out action accuracy by training data]({plot})", ""]
    lines += [*_table(ablation), "", *_verdicts(ablation), ""]
    if ablation.recipe.compare:
        lines += ["## Differences", "", *_comparisons(ablation), ""]
    return "\n".join(lines)


def report_html(markdown: str, picture_base64: str) -> str:
    """The same as one page that needs nothing else."""
    body = []
    for block in markdown.split("\n\n"):
        if block.startswith("#"):
            level = len(block) - len(block.lstrip("#"))
            body.append(f"<h{level}>{_inline(block.lstrip('# '))}</h{level}>")
        elif block.startswith("!["):
            body.append(f'<img alt="" src="data:image/png;base64,{picture_base64}">')
        elif block.startswith("|"):
            body.append(_html_table(block.splitlines()))
        elif block.startswith("- "):
            items = "".join(f"<li>{_inline(line[2:])}</li>" for line in block.splitlines())
            body.append(f"<ul>{items}</ul>")
        elif block.strip():
            body.append(f"<p>{_inline(block)}</p>")
    style = (
        "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
        "table{border-collapse:collapse;display:block;overflow-x:auto}"
        "td,th{padding:.3rem .7rem;border-bottom:1px solid #ddd;text-align:right}"
        "td:first-child,th:first-child{text-align:left}img{max-width:100%}"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Ablation</title>'
        f"<style>{style}</style>{''.join(body)}</html>\n"
    )


def _setting(ablation: Ablation) -> list[str]:
    config, holdout = ablation.config, ablation.holdout
    held = ", ".join(f"{len(selection)} {name}" for name, selection in ablation.held.items())
    what = (
        f"whole scenes ({', '.join(holdout.scenes)})"
        if holdout.by == "scene"
        else "trajectories of scenes that training knows"
    )
    scenes = len({scene_of(t) for t in holdout.trajectories})
    return [
        f"Held out: {what}; {len(holdout.trajectories)} trajectories in {scenes} "
        f"scene{'s' * (scenes > 1)}, none of which any row has seen by any robot. Episodes "
        f"predicted: {held}.",
        "",
        f"Every row: {config.seeds} training{'s' * (config.seeds > 1)} of {config.steps} steps of "
        f"{config.batch} episodes, images of {config.size_px} px, whatever its amount of data. "
        "Predicted step by step with the true steps before (teacher forcing), so these are no "
        "success rates. Action: part of the steps whose action (of 4) is right. Waypoints: mean "
        "distance of the next 8 poses. Stop: mean of the parts of the steps within 4 steps of "
        "the end, and of the others, that are recognised; 50 % is chance.",
        "",
        f"± is Student's t-interval at 95 % over {config.seeds} seeds: how much trainings vary, "
        "not scenes."
        if config.seeds > 1
        else "One training per row tells nothing of how much trainings vary.",
    ]


def _table(ablation: Ablation) -> list[str]:
    where = list(ablation.held)
    head = ["trained on", "episodes", *(f"{w}: {_TITLES[m]}" for w in where for m in _TITLES)]
    lines = ["| " + " | ".join(head) + " |", "| --- | ---:" + " | ---:" * (len(head) - 2) + " |"]
    for name, row in estimates(ablation).items():
        trained = ablation.rows.get(name)
        count = str(sum(len(s.selection) for s in trained.plan.sources)) if trained else "–"
        cells = [_cell(metric, row[w][metric]) for w in where for metric in _TITLES]
        lines.append("| " + " | ".join([name, count, *cells]) + " |")
    return lines


def _verdicts(ablation: Ablation) -> list[str]:
    """Which rows beat the commonest action by enough, and if not, what that looks like."""
    found = estimates(ablation)
    lines = []
    for where in ablation.held:
        constant = found[CONSTANT][where]["action"].mean
        best = max(ablation.rows, key=lambda name: found[name][where]["action"].mean)
        reached = found[best][where]["action"].mean
        gain = reached - constant
        text = (
            f"- **{where}**: the best row ({best}) is {100 * gain:+.1f} points from the commonest "
            f"action ({100 * constant:.1f} %)"
        )
        short = [
            name for name in ablation.rows if found[name][where]["action"].mean - constant < MARGIN
        ]
        if gain >= MARGIN:
            text += "; asked for: at least +10. "
            if short:
                text += f"Not reached by: {', '.join(short)}."
        else:
            text += f", short of the +10 asked for. {_why(ablation.rows[best], reached, constant)}"
        lines.append(text.rstrip())
    return lines


def _why(row: Row, reached: float, constant: float) -> str:
    left = 1 - constant
    if left < 2 * MARGIN:
        return (
            f"All other actions are only {100 * left:.1f} % of the steps, so +10 would be most of "
            f"what can be gained. {_fit(row, reached, left / 2)}"
        )
    return _fit(row, reached, MARGIN)


def _fit(row: Row, reached: float, much: float) -> str:
    """Whether it lacks data or training: it lacks data if it does `much` better on what it saw."""
    fitted = over_seeds([Summary.of(run).action for run in row.training]).mean
    episodes = sum(len(source.selection) for source in row.plan.sources)
    if fitted - reached > much:
        return (
            f"It gets {100 * fitted:.1f} % of its training steps right, so it fits what it has "
            f"seen, and {episodes} episodes are too few to carry over: collect more."
        )
    return (
        f"It gets only {100 * fitted:.1f} % of its training steps right, so it is trained too "
        "briefly or too small: raise steps or model sizes."
    )


def _comparisons(ablation: Ablation) -> list[str]:
    lines = [
        "Interval: Welch's t at 95 %, over seeds and over bootstrapped held-out trajectories, the "
        "same trajectories for both rows. It is of these held-out scenes; other scenes vary more. "
        "Bold: 0 is outside; of many numbers some are so by chance.",
        "",
        "| | on | action, points | waypoints, m | stop, points |",
        "| --- | --- | ---: | ---: | ---: |",
    ]
    for entry in differences(ablation):
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


def _inline(text: str) -> str:
    parts = html.escape(text).split("**")
    return "".join(f"<b>{p}</b>" if n % 2 else p for n, p in enumerate(parts))


def _html_table(lines: list[str]) -> str:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    head = "".join(f"<th>{_inline(cell)}</th>" for cell in rows[0])
    body = "".join(
        "<tr>" + "".join(f"<td>{_inline(cell)}</td>" for cell in row) + "</tr>" for row in rows[2:]
    )
    return f"<table><tr>{head}</tr>{body}</table>"
