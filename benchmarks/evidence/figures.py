"""The figures of a page: rates by row, SR against the amount of data, training curves."""

from __future__ import annotations

import io
import textwrap
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from benchmarks.evidence.digest import walks_of
from benchmarks.evidence.judge import mean_interval
from benchmarks.evidence.records import Row, Table, Training
from vlnpe.learning.ablation.intervals import Difference
from vlnpe.learning.ablation.plotting import COLOURS, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Text stays text, and equal numbers give equal files.
_STYLE: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "vlnpe", "font.size": 9}
AMOUNT = 7  # number of the table
_ROW_IN = 0.2  # height of a row of `_rates`
_ASIDE = (1.0, 1.02, 0.98)  # factors of the places of points with the same number of paths


def figures(value: Mapping[str, Any], tables: Mapping[int, Table]) -> dict[str, bytes]:
    """Return the SVG pictures by key, those that have something to show.

    Args:
        value: content of the compact file.
        tables: all of them by number.
    """
    import matplotlib

    measured = {table: _measured(value, table) for table in tables.values()}
    with matplotlib.rc_context(_STYLE):
        drawn = {
            "rates": _rates(measured),
            "amount": _amount(value, measured[tables[AMOUNT]]),
            "curves": _curves(value, tables.values()),
        }
        return {name: _svg(figure) for name, figure in drawn.items() if figure is not None}


def _rates(measured: Mapping[Table, Mapping[Row, Difference]]) -> Figure | None:
    """Draw SR with its interval for every measured row, a panel per table."""
    panels = {table: rows for table, rows in measured.items() if len(rows) > 1}
    if not panels:
        return None
    # Fixed margins: the constrained layout moves by rounding errors from one drawing to the next.
    heights = [len(rows) for rows in panels.values()]
    drawn_in, gap_in = _ROW_IN * sum(heights), 0.6
    total_in = drawn_in + gap_in * len(panels) + 0.2
    figure = _new((7.6, total_in), layout=None)
    figure.subplots_adjust(
        left=0.4,
        right=0.97,
        bottom=0.5 / total_in,
        top=1 - 0.3 / total_in,
        hspace=gap_in * len(panels) / drawn_in,
    )
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)
    for axis, (table, rows), colour in zip(
        axes.ravel(), panels.items(), COLOURS * len(panels), strict=False
    ):
        for height, found in enumerate(rows.values()):
            _dot(axis, found.mean, height, found, colour, along="x")
        axis.set_yticks(range(len(rows)), [row.label for row in rows])
        axis.set_ylim(len(rows) - 0.5, -0.5)
        axis.set_title(f"{table.number}. {table.title}", fontsize=9.5, loc="left")
        axis.tick_params(labelbottom=True)
        tidy(axis, "x")
    axes[-1, 0].set_xlabel("SR [%]")
    axes[-1, 0].set_xlim(0, None)
    return figure


def _amount(value: Mapping[str, Any], measured: Mapping[Row, Difference]) -> Figure | None:
    """Draw SR against the paths that were trained on, on a logarithmic axis."""
    lines: dict[str, list[tuple[int, Difference]]] = defaultdict(list)
    for row, found in measured.items():
        names = (row.cell(seed) for seed in value["seeds"])
        cell = next(value["cells"][name] for name in names if name in value["cells"])
        if isinstance(row.policy, Training) and "episodes" in cell:
            for name in _series(row.policy):
                lines[name].append((cell["episodes"], found))
    lines = {
        name: sorted(points, key=lambda point: point[0])
        for name, points in lines.items()
        if len({paths for paths, _ in points}) > 1
    }
    if not lines:
        return None
    figure = _new((5.6, 3.2))
    axis = figure.subplots()
    # Side by side where both have the same number of paths.
    for (name, points), colour, aside in zip(lines.items(), COLOURS, _ASIDE, strict=False):
        at = [aside * paths for paths, _ in points]
        axis.plot(at, [f.mean for _, f in points], color=colour, linewidth=1, label=name)
        for place, (_, found) in zip(at, points, strict=True):
            _dot(axis, place, found.mean, found, colour, along="y")
    axis.set_xscale("log")
    ticks = sorted({paths for points in lines.values() for paths, _ in points})
    axis.set_xticks(ticks, [str(tick) for tick in ticks])
    axis.minorticks_off()
    axis.set_xlabel("paths trained on")
    axis.set_ylabel("SR [%]")
    axis.set_ylim(0, None)
    axis.legend(frameon=False)
    tidy(axis, "y")
    return figure


def _series(training: Training) -> tuple[str, ...]:
    scenes, paths = "more scenes", "more paths in the same scenes"
    if training.longer > 1:
        return (f"{scenes}, {training.longer} times the steps",)
    if training.fraction < 1:
        return (paths,)
    return (scenes,) if training.scenes else (scenes, paths)  # all of both ends both lines


def _curves(value: Mapping[str, Any], tables: Iterable[Table]) -> Figure | None:
    """Draw the parts of training and held-out actions that are right against the step.

    Models that choose no single actions have a panel with their loss, on a scale of its own.
    """
    policies = (row.policy for table in tables for row in table.rows)
    labels = {one.name: one.label for one in policies if isinstance(one, Training)}
    found = {
        cell["checkpoint_sha256"]: (name.rsplit("--", 1)[0], cell["curve"])
        for name, cell in sorted(value["cells"].items())
        if cell.get("curve")
    }
    seeds: dict[str, list[Any]] = {label: [] for label in labels.values()}  # in their order
    for cell, curve in found.values():
        name: str = cell.rsplit("-s", 1)[0]
        seeds.setdefault(labels.get(name, name), []).append(curve)
    right = {name: curves for name, curves in seeds.items() if _has(curves, "held action")}
    lost = {
        n: curves for n, curves in seeds.items() if n not in right and _has(curves, "held loss")
    }
    panels = right | lost
    if not panels:
        return None
    columns = 3
    rows = -(-len(panels) // columns)
    figure = _new((7.6, 1.7 * rows + 0.7))
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for unused in axes[len(panels) :]:
        unused.remove()
    for place, (axis, (name, curves)) in enumerate(zip(axes, panels.items(), strict=False)):
        what, scale = ("action", 100.0) if name in right else ("loss", 1.0)
        for curve in curves:
            steps = [point["step"] for point in curve]
            for key, colour, label in (
                (f"train {what}", COLOURS[0], "training walks"),
                (f"held {what}", COLOURS[1], "held-out walks"),
                ("held constant", "#888", "the commonest action"),
            ):
                heights = [scale * point.get(key, np.nan) for point in curve]
                axis.plot(steps, heights, color=colour, linewidth=1, marker=".", label=label)
        axis.set_title(textwrap.fill(name, 40), fontsize=7)
        axis.tick_params(labelbottom=True, labelleft=name in lost or place % columns == 0)
        if name in lost:
            axis.set_ylabel("loss of motions", fontsize=7)
            axis.set_ylim(0, 1.1 * axis.dataLim.y1)
        elif place:
            axis.sharey(axes[0])
        tidy(axis, "y")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles[:3], names[:3], loc="outside lower center", ncols=3, frameon=False)
    for axis in axes[: len(panels)][-columns:]:
        axis.set_xlabel("optimiser step")
    if right:
        figure.supylabel("actions right [%]", fontsize=9)
    return figure


def _has(curves: Iterable[Sequence[Mapping[str, float]]], key: str) -> bool:
    """Return whether curves have a score, e.g. `held action`."""
    return any(key in point for curve in curves for point in curve)


def _measured(value: Mapping[str, Any], table: Table) -> dict[Row, Difference]:
    """Return SR with its interval of the rows that have results."""
    found = {row: walks_of(value, table, row.label) for row in table.rows}
    return {row: mean_interval(walks, "SR") for row, walks in found.items() if walks is not None}


def _dot(axis: Axes, x: float, y: float, found: Difference, colour: str, *, along: str) -> None:
    """Draw a point with its interval; `along` says which axis the interval lies along."""
    ends = np.maximum([[found.mean - found.low], [found.high - found.mean]], 0.0)
    sideways, upwards = (ends, None) if along == "x" else (None, ends)
    axis.errorbar(x, y, upwards, sideways, fmt="o", color=colour, capsize=3, markersize=4.5)


def _new(
    size_in: tuple[float, float], layout: Literal["constrained"] | None = "constrained"
) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=size_in, layout=layout, facecolor="white")


def _svg(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()
