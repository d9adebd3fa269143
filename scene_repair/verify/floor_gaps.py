"""Check that holes listed as filled are closed, and that remaining gaps are listed."""

from typing import Any

import cv2
import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.morphology import Window, grow, grown_window, label, windows
from .probe_rays import Probes

# Smaller gaps carry every foot and wheel.
LEAST_GAP_M = 0.05
# A gap is accounted for if listed holes cover this share of it, their borders being off by this.
SHARE, BORDER_M = 0.5, 0.03
# It is a gap in the floor if floor makes up this share of its rim, this many probes wide; what is
# left is the inside of walls and doors.
RIM, RIM_SHARE = 2, 0.6


def hole_cells(hole: dict[str, Any], grid: GridSpec, border: int) -> tuple[Window, Mask]:
    """Return the cells of a grid whose centres lie in a hole of `repair.json`.

    They lie in the window that is returned first, with a border of so many cells around them.
    """
    rings = [
        (np.asarray(polygon) - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
        for polygon in hole["polygons_xy_m"]
    ]
    if not rings:
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0), dtype=bool)
    every = np.concatenate(rings)[:, ::-1]
    limit = np.array(grid.shape)
    low = np.clip(np.floor(every.min(axis=0)).astype(int) - border, 0, limit)
    high = np.clip(np.ceil(every.max(axis=0)).astype(int) + border + 1, 0, limit)
    drawn = np.zeros(high - low, dtype=np.uint8)
    scale = 16
    if drawn.size:
        corners = [np.rint((ring - low[::-1]) * scale).astype(np.int32) for ring in rings]
        cv2.fillPoly(drawn, corners, 1, shift=4)
    window = slice(int(low[0]), int(high[0])), slice(int(low[1]), int(high[1]))
    return window, drawn.astype(bool)


def check_holes(
    probes: Probes, floor: Mask, holes: list[dict[str, Any]]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Compare the holes listed in `repair.json` with what probes find; `floor` is over their grid.

    Returns:
        Holes said to be filled through which probes fall, and gaps inside the building of 5 cm or
        more that are not on the list; both with a position and an area.
    """
    grid, fell = probes.grid, probes.fell
    cell_m2 = grid.cell_m**2
    least = LEAST_GAP_M / grid.cell_m
    border = max(round(BORDER_M / grid.cell_m), 1)
    still_open, listed = [], np.zeros(grid.shape, dtype=bool)
    for number, hole in enumerate(holes):
        window, cells = hole_cells(hole, grid, border + RIM)
        if hole["action"] != "filled":
            listed[window] |= cells
            continue
        # Holes are listed by sampled cells, which reach a little into the walls around them; those
        # that are all border may lie in walls altogether.
        inner = ~grow(~cells, border)
        open_ = fell[window] & (inner if inner.any() else cells)
        large = open_.sum() >= max(least**2, SHARE * cells.sum())
        if open_.any() and (inner.any() or (large and _in_floor(open_, floor[window]))):
            through = np.argwhere(open_) + np.array([w.start for w in window])
            still_open.append(
                {
                    "hole": number,
                    "xy_m": _rounded(grid.center_of(through[0])),
                    "open_area_m2": round(len(through) * cell_m2, 5),
                }
            )
    listed = grow(listed, border)
    parts, _ = label(fell)
    unlisted = []
    for number, (rows, columns) in enumerate(windows(parts), start=1):
        at_border = rows.start == 0 or columns.start == 0
        at_border |= rows.stop == grid.rows or columns.stop == grid.columns
        if at_border or min(rows.stop - rows.start, columns.stop - columns.start) < least:
            continue
        selected = parts[rows, columns] == number
        area = int(selected.sum())
        if area < least**2 or listed[rows, columns][selected].mean() >= SHARE:
            continue
        wide = grown_window((rows, columns), RIM, grid.shape)
        if not _in_floor(parts[wide] == number, floor[wide]):
            continue
        inside = np.argwhere(selected)[area // 2] + np.array([rows.start, columns.start])
        unlisted.append(
            {"xy_m": _rounded(grid.center_of(inside)), "area_m2": round(area * cell_m2, 5)}
        )
    return still_open, unlisted


def _in_floor(gap: Mask, floor: Mask) -> bool:
    rim = grow(gap, RIM) & ~gap
    return bool(floor[rim].mean() >= RIM_SHARE)


def _rounded(xy_m: Array) -> list[float]:
    return [round(float(v), 3) for v in xy_m]
