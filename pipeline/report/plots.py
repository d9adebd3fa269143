"""The report's histograms."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Plot:
    """An inline SVG and what it shows."""

    svg: str
    caption: str


def histogram(values: Sequence[float], label: str, caption: str) -> Plot:
    """Return a histogram of `values` as SVG text; an empty one says that there is no data.

    Args:
        values: numbers to count.
        label: of the horizontal axis, with the unit.
        caption: what the figure shows; the mean is added.
    """
    import matplotlib

    matplotlib.use("svg")
    # Text stays text and ids stay the same, so that equal runs give equal pages.
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "vlnpe"})
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(5.4, 3.0), layout="constrained")
    axes = figure.subplots()
    if values:
        axes.hist(values, bins="auto" if len(values) > 12 else 6, color="#2b5fb8", rwidth=0.92)
        caption = f"{caption} Mean {sum(values) / len(values):.1f}."
    else:
        axes.text(0.5, 0.5, "no data", ha="center", transform=axes.transAxes)
    axes.set_xlabel(label)
    axes.set_ylabel("episodes")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.spines[["top", "right"]].set_visible(False)
    stream = io.StringIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return Plot(text[text.index("<svg") :], caption)
