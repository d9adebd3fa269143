"""The ablation's picture: held-out action accuracy of every row, by robot."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping

from .intervals import Estimate
from .report import CONSTANT, REPEAT

_COLOURS = ("#2b5fb8", "#c8611a", "#2e8b57", "#7b4aa8", "#a83250", "#5c6770")


def plot_png(rows: Mapping[str, Mapping[str, Mapping[str, Estimate]]], title: str) -> bytes:
    """Dots with intervals by row and evaluated source, and the baselines as lines; PNG bytes."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib.figure import Figure

    trained = [name for name in rows if name not in (CONSTANT, REPEAT)]
    places = list(rows[CONSTANT])
    columns = min(len(places), 3)  # more would be too small to read on a page
    rows_of = math.ceil(len(places) / columns)
    figure = Figure(
        figsize=(3.4 * columns + 2.2, (0.42 * len(trained) + 1.3) * rows_of + 0.4),
        layout="constrained",
    )
    axes = figure.subplots(rows_of, columns, sharey=True, squeeze=False).ravel()
    for unused in axes[len(places) :]:
        unused.remove()
    for place, axis, colour in zip(places, axes, _COLOURS * len(places), strict=False):
        for name, style in ((CONSTANT, "--"), (REPEAT, ":")):
            value = 100 * rows[name][place]["action"].mean
            axis.axvline(value, color="#888", linestyle=style, linewidth=1.2, label=name)
        for height, name in enumerate(trained):
            value = rows[name][place]["action"]
            half = 0.0 if math.isnan(value.half) else 100 * value.half
            axis.errorbar(
                100 * value.mean, height, xerr=half, fmt="o", color=colour, capsize=3, markersize=6
            )
        axis.set_title(place, fontsize=11)
        axis.set_xlabel("held-out actions right [%]")
        axis.grid(axis="x", color="#eee")
        axis.set_axisbelow(True)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_yticks(range(len(trained)), trained)
    axes[0].set_ylim(len(trained) - 0.5, -0.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside lower center", ncols=2, frameon=False)
    figure.suptitle(title, fontsize=12)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    return stream.getvalue()
