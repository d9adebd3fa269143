"""An ablation as a page: answers, table, and the rates as a figure."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...datasets.mixture.comparison import METRICS
from ...evaluation.results import COLUMNS, cell_text, decimals
from ...evaluation.statistics import LEAST_PATHS
from ...formats.core.atomic import write_bytes
from ...formats.core.images import data_uri
from ..report.markdown_page import markdown_page
from .results import Judgement, interval, judge

REPORT, FIGURE, PAGE = "report.md", "rates.svg", "report.html"
SENTENCES = 3  # claims that are answered in sentences; more become a table


def write_page(out: Path, value: Mapping[str, Any]) -> None:
    """Write report.md with its figure, and both as report.html, which needs no other file."""
    text, figure = markdown(value), figure_svg(value)
    page = markdown_page("Ablation", text)
    page = page.replace(f'src="{FIGURE}"', f'src="{data_uri(figure, "image/svg+xml")}"')
    write_bytes(out / FIGURE, figure)
    write_bytes(out / REPORT, text.encode())
    write_bytes(out / PAGE, page.encode())


def markdown(value: Mapping[str, Any]) -> str:
    """Return the report: answers first, then the table and what it rests on."""
    scenes = {scene for _, scene, _, _ in value["episodes"]}
    parts = [
        f"# {value['title'] or 'Ablation'}",
        *_answers(judge(value)),
        *value["notes"],
        f"![SR with its 95 % interval by row]({FIGURE})",
        _table(value),
        f"Every policy walked the same {len(value['episodes'])} episodes in {len(scenes)} scenes, "
        "which no row is trained on, in closed loop; one seed is one training. Cells are means "
        "with 95 % intervals over seeds and over scenes and paths: the variances are added, and "
        "the width is Student's t. With one seed they do not cover other trainings. Differences "
        "are paired by episode. Claims are not corrected for their number. "
        "SR: stopped within 3 m of the goal; OS: passed within 3 m; SPL: SR weighted by path "
        "length; NE: distance to the goal at the end; FR: fell; StR: got stuck; "
        "CR: touched an obstacle.",
        *_doubts(value),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _answers(judgements: Sequence[Judgement]) -> list[str]:
    """Return each claim's verdict in a sentence, or those of many claims as a table."""
    if len(judgements) <= SENTENCES:
        return [answer(judgement) for judgement in judgements]
    lines = ["| claim | difference | verdict |", "| --- | --- | --- |"]
    for judgement in judgements:
        claim = judgement.claim
        seeds = ", with one seed" if judgement.seeds == 1 else ""
        lines.append(
            f"| {claim['text']} ({claim['more']} − {claim['less']}) | {_difference(judgement)} | "
            f"{judgement.verdict}{seeds} |"
        )
    halved = "To halve an interval takes about four times as many seeds and scenes."
    return ["\n".join(lines), halved]


def answer(judgement: Judgement) -> str:
    """Return a claim's verdict with its interval in a sentence, and what a smaller one needs."""
    claim, difference = judgement.claim, judgement.difference
    text = (
        f"**{claim['text']}: {judgement.verdict}** ({claim['more']} − {claim['less']}: "
        f"{_difference(judgement)})."
    )
    if difference is None:
        return text
    if judgement.seeds == 1:
        text += " One seed does not show how much trainings vary: give --seeds 3."
    half = difference.half_width
    factor = difference.factor_to_show(half / 2) if half > 0 else None
    if factor is None:
        return text
    unit, digits = _unit(claim["metric"])
    seeds = f"{judgement.seeds * factor} seeds and " if judgement.seeds else ""
    return (
        f"{text} Differences below about {half:.{digits}f} {unit} cannot be seen with these "
        f"{judgement.episodes} episodes in {judgement.scenes} scenes; {half / 2:.{digits}f} would "
        f"need about {seeds}{judgement.episodes * factor} episodes in {judgement.scenes * factor} "
        f"scenes ({difference.seeds_share:.0%} of the variance lies between seeds)."
    )


def _difference(judgement: Judgement) -> str:
    """Return a claim's difference with its interval in words."""
    metric, difference = judgement.claim["metric"], judgement.difference
    if difference is None:
        return "–"
    unit, digits = _unit(metric)
    text = f"{metric} {difference.mean:+.{digits}f}"
    if math.isnan(difference.low):
        return f"{text} {unit} without an interval, as fewer than {LEAST_PATHS} paths were walked"
    return f"{text} ({difference.low:+.{digits}f} … {difference.high:+.{digits}f}) {unit}"


def _unit(metric: str) -> tuple[str, int]:
    """Return the unit of a metric's differences, and how many decimals they are shown with."""
    unit = COLUMNS[metric][0]
    return "points" if unit == "%" else unit, decimals(metric)


def _table(value: Mapping[str, Any]) -> str:
    heads = [f"{name} [{COLUMNS[name][0]}]" for name in METRICS]
    lines = [f"| row | trained on | seeds | {' | '.join(heads)} |"]
    lines.append("| --- | ---: | ---: |" + " ---: |" * len(heads))
    for row in value["rows"]:
        if row["seeds"]:
            count = row["training"]["episodes"] if "training" in row else "–"
            means = [interval(value, row, name) for name in METRICS]
            cells = [
                "–" if mean is None else cell_text(name, mean)
                for name, mean in zip(METRICS, means, strict=True)
            ]
            head = f"| {row['label']} | {count} | {len(row['seeds'])} | "
            lines.append(f"{head}{' | '.join(cells)} |")
    return "\n".join(lines)


def _doubts(value: Mapping[str, Any]) -> list[str]:
    """Return what is missing, as paragraphs."""
    lines = []
    for row in value["rows"]:
        if not row["seeds"]:
            lines.append(f"Not measured: {row['label']}. {row.get('missing', '')}".strip())
        failed = {uid: why for cell in row["seeds"].values() for uid, why in cell["failed"].items()}
        if failed:
            first = next(iter(failed.values()))
            lines.append(f"{row['label']}: {len(failed)} episodes without a result: {first}")
    return lines


def figure_svg(value: Mapping[str, Any]) -> bytes:
    """Return SR with its interval for every measured row as an SVG file."""
    from ..report.plots import COLORS, horizontal_axes, svg

    rows = [(row, interval(value, row, "SR")) for row in value["rows"]]
    rows = [(row, mean) for row, mean in rows if mean is not None]
    tests = list(dict.fromkeys(row["test"] for row, _ in rows))
    figure, axis = horizontal_axes(0.24 * len(rows) + 0.9)
    for height, (row, mean) in enumerate(rows):
        ends = [[max(mean.mean - mean.low, 0.0)], [max(mean.high - mean.mean, 0.0)]]
        color = COLORS[tests.index(row["test"]) % len(COLORS)]
        axis.errorbar(mean.mean, height, xerr=ends, fmt="o", color=color, capsize=3, markersize=4.5)
    axis.set_yticks(range(len(rows)), [row["label"] for row, _ in rows])
    axis.set(ylim=(len(rows) - 0.5, -0.5), xlim=(0, None), xlabel="SR [%]")
    return svg(figure)
