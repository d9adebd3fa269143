"""What the plots of results have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = ("#2b5fb8", "#c8611a", "#2e8b57", "#7b4aa8", "#a83250", "#5c6770")


def tidy(axis: Axes, grid: Literal["x", "y"]) -> None:
    """Give an axis faint grid lines behind what is drawn, and no frame above and on the right."""
    axis.grid(axis=grid, color="#eee")
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
