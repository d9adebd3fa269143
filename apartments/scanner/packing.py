"""Packs charts into texture pages, all charts of an object on one page."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .charts import Charts

PADDING = 2


@dataclass(frozen=True)
class Packing:
    """Where the charts lie.

    Attributes:
        page: (C,) int64 page of each chart.
        origin: (C, 2) int64 x, y of each chart's first texel, padding excluded.
        page_size: width and height of every page [texels].
    """

    page: NDArray[np.int64]
    origin: NDArray[np.int64]
    page_size: tuple[tuple[int, int], ...]


def pack(charts: Charts, page_px: int) -> Packing:
    """Pack on as few pages of at most `page_px` squared as shelves allow.

    Raises:
        ValueError: one object alone does not fit on a page.
    """
    boxes = charts.size + 2 * PADDING
    objects = np.unique(charts.object)
    need = np.bincount(charts.object, boxes.prod(1))
    page = np.zeros(len(boxes), dtype=np.int64)
    origin = np.zeros((len(boxes), 2), dtype=np.int64)
    sizes: list[tuple[int, int]] = []
    at = 0
    while at < len(objects):
        total = np.cumsum(need[objects[at:]])
        # Shelves lose a little space, so that a full page's worth of area may overflow.
        take = max(int(np.searchsorted(total, 0.97 * page_px**2)), 1)
        while True:
            mine = np.flatnonzero(np.isin(charts.object, objects[at : at + take]))
            places, height = _shelves(boxes[mine], page_px)
            if height <= page_px:
                break
            if take == 1:
                raise ValueError(
                    f"texture of one object needs {height} rows; valid: at most page_px = {page_px}"
                )
            take = max(int(take * 0.95), 1) if take > 20 else take - 1
        page[mine] = len(sizes)
        origin[mine] = places + PADDING
        sizes.append((page_px, -(-height // 4) * 4))
        at += take
    return Packing(page, origin, tuple(sizes))


def _shelves(boxes: NDArray[np.int64], width: int) -> tuple[NDArray[np.int64], int]:
    """Places (N, 2) of boxes (N, 2) in rows of falling height, and the height needed."""
    order = np.lexsort((boxes[:, 0], -boxes[:, 1]))
    places = np.zeros_like(boxes)
    x = y = shelf = 0
    for k in order.tolist():
        w, h = int(boxes[k, 0]), int(boxes[k, 1])
        if w > width:
            return places, 1 << 30
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        places[k] = x, y
        x += w
        shelf = max(shelf, h)
    return places, y + shelf
