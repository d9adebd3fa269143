"""An ablation's report as one HTML page, from its Markdown."""

import io
import math
from collections.abc import Mapping

from markdown_it import MarkdownIt

from ...formats.core.images import data_uri
from .intervals import Estimate
from .plotting import COLOURS, tidy
from .report import CONSTANT, REPEAT

# Columns of numbers are aligned to the right and never wrap; the others may.
STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:64rem;margin:2rem auto;padding:0 1rem}"
    ".wide{overflow-x:auto}table{border-collapse:collapse}"
    "td,th{padding:.3rem .7rem;border-bottom:1px solid #ddd;text-align:left;"
    "overflow-wrap:anywhere;min-width:5rem}"
    "[style*=right]{white-space:nowrap;min-width:0}"
    "img{max-width:100%}"
)


def report_html(markdown: str, picture_name: str, picture: bytes) -> str:
    """Return the report as a page that needs no other file.

    Args:
        picture: Content of the picture, a PNG file.
    """
    body = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    body = body.replace(f'src="{picture_name}"', f'src="{data_uri(picture, "image/png")}"')
    body = body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Ablation</title>'
        f"<style>{STYLE}</style>{body}</html>\n"
    )


def plot_png(rows: Mapping[str, Mapping[str, Mapping[str, Estimate]]], title: str) -> bytes:
    """Return a PNG plot: dots with intervals by row and evaluated source, baselines as lines."""
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
    for place, axis, colour in zip(places, axes, COLOURS * len(places), strict=False):
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
        tidy(axis, "x")
    axes[0].set_yticks(range(len(trained)), trained)
    axes[0].set_ylim(len(trained) - 0.5, -0.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside lower center", ncols=2, frameon=False)
    figure.suptitle(title, fontsize=12)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    return stream.getvalue()
