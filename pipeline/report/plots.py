"""Figures of a dataset, drawn by matplotlib: histograms, and bars."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from ...formats.core.images import data_uri

# Distinguishable with every colour vision (Okabe and Ito, 2008).
COLORS = ("#2b5fb8", "#d55e00", "#009e73", "#cc79a7", "#8060d0", "#5c6878")
# The page's font, as text; the same figure has the same bytes.
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "vlnpe",
    "font.size": 9,
    "font.family": "sans-serif",
}
_BINS = 15


@dataclass(frozen=True)
class Plot:
    """A figure as a data URI of an SVG, and what it shows."""

    uri: str
    caption: str


def step_histogram(
    values: Mapping[str, Sequence[float]],
    label: str,
    unit: str,
    marks: Mapping[str, float] | None = None,
) -> Figure:
    """Return the histograms of several groups over the same bins, as shares of each group.

    Args:
        values: Numbers by group. Bins of whole numbers stand about them.
        label: Label of the horizontal axis, with the unit.
        unit: What is counted.
        marks: Vertical lines by name.
    """
    figure, axes = _axes()
    everything = np.array([v for group in values.values() for v in group], dtype=np.float64)
    if not len(everything):
        return _empty(figure, axes)
    whole = bool((everything == everything.round()).all())
    if whole:
        step = -(-max(1, int(np.ptp(everything))) // _BINS)
        edges = np.arange(everything.min(), everything.max() + step + 1, step) - 0.5
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    else:
        edges = np.histogram_bin_edges(everything, _BINS)
    for (name, group), color in zip(values.items(), _colors(values), strict=True):
        shares = np.histogram(group, edges)[0] / max(1, len(group))
        axes.stairs(shares, edges, color=color, label=name, linewidth=2, baseline=0)
        axes.stairs(shares, edges, color=color, fill=True, alpha=0.12)
    for name, value in (marks or {}).items():
        if edges[0] <= value <= edges[-1]:
            axes.axvline(value, color="#5c6878", linestyle="--", linewidth=1, label=name)
    axes.set(xlabel=label, ylabel=f"share of {unit}")
    return _finished(figure, axes)


def bars(shares: Mapping[str, Mapping[str, float]], label: str) -> Figure:
    """Return grouped bars: for each name one bar per group, with values in [0, 1].

    Args:
        shares: Values by name, by group.
        label: Label of the vertical axis.
    """
    figure, axes = _axes()
    names = list(next(iter(shares.values()), {}))
    if not names:
        return _empty(figure, axes)
    width = 0.8 / len(shares)
    for k, ((group, values), color) in enumerate(zip(shares.items(), _colors(shares), strict=True)):
        place = np.arange(len(names)) + (k - (len(shares) - 1) / 2) * width
        axes.bar(place, [values[name] for name in names], 0.95 * width, color=color, label=group)
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel(label)
    return _finished(figure, axes)


def svg(figure: Figure) -> bytes:
    """Return a figure as an SVG file."""
    stream = BytesIO()
    with rc_context(_STYLE):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def svg_uri(figure: Figure) -> str:
    """Return a figure as the data URI of an SVG image."""
    return data_uri(svg(figure), "image/svg+xml")


def horizontal_axes(height_in: float) -> tuple[Figure, Axes]:
    """Return axes for rows of values, as high as asked [inch], with vertical grid lines."""
    figure, axes = _axes(7.6, height_in)
    axes.grid(axis="x", color="#eee")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _axes(width_in: float = 5.6, height_in: float = 3.1) -> tuple[Figure, Axes]:
    with rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        return figure, figure.subplots()


def _finished(figure: Figure, axes: Axes) -> Figure:
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.grid(axis="y", color="#d9dfe7")
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    figure.legend(loc="outside upper left", ncols=4, frameon=False)
    return figure


def _empty(figure: Figure, axes: Axes) -> Figure:
    axes.set_axis_off()
    axes.text(0.5, 0.5, "no data", ha="center")
    return figure


def _colors(names: Mapping[str, object]) -> list[str]:
    return [COLORS[k % len(COLORS)] for k in range(len(names))]
