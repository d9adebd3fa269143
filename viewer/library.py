"""The walks of a run as the viewer lists them: filters, outliers, a sheet of pictures."""

import html
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..formats.core.arrays import U8
from ..formats.core.flags import FlagFile
from .walk import Walk

ALL = "all"
TILE_PX = 160
ROWS = 40  # of the table
ORDERS = ("name", "longest first", "slowest first", "outliers first", "touched first")


@dataclass(frozen=True)
class Entry:
    """A walk in the list.

    Attributes:
        name: `<robot>/<controller>/<episode>`, `<evaluation>: …` for one of an evaluation.
        folder, item: whose `FlagFile` has it under which name.
        path: of its episode; walks of one path can be shown together.
        contacts: how often the robot touched an obstacle.
        load: opens the walk.
        ends: returns the first and the last picture, None where there is none.
    """

    name: str
    folder: Path
    item: str
    robot: str
    controller: str
    path: str
    scene: str
    outcome: str
    length_m: float
    seconds: float
    contacts: int
    load: Callable[[], Walk] = field(compare=False)
    ends: Callable[[], tuple[U8, U8] | None] = field(compare=False)

    @property
    def speed_m_s(self) -> float:
        """Mean speed; a robot that stands still for long has a low one."""
        return self.length_m / max(self.seconds, 0.01)


@dataclass(frozen=True)
class Choice:
    """What of the list is shown."""

    robot: str = ALL
    controller: str = ALL
    outcome: str = ALL
    touched: bool = False
    flagged: bool = False
    length_m: tuple[float, float] = (0.0, np.inf)
    order: str = "name"


def flagged_in(entries: Sequence[Entry]) -> dict[str, str]:
    """Return the notes of the flagged entries by name."""
    notes = {folder: FlagFile(folder).flagged() for folder in {e.folder for e in entries}}
    return {e.name: notes[e.folder][e.item] for e in entries if e.item in notes[e.folder]}


def chosen(entries: Sequence[Entry], choice: Choice, flagged: Collection[str]) -> list[Entry]:
    """Return the entries of a choice, in its order."""
    low, high = choice.length_m
    picked = [
        e
        for e in entries
        if choice.robot in (ALL, e.robot)
        and choice.controller in (ALL, e.controller)
        and choice.outcome in (ALL, e.outcome)
        and low <= e.length_m <= high
        and (e.contacts or not choice.touched)
        and (e.name in flagged or not choice.flagged)
    ]
    if choice.order == "longest first":
        picked.sort(key=lambda e: -e.length_m)
    elif choice.order == "slowest first":
        picked.sort(key=lambda e: e.speed_m_s)
    elif choice.order == "touched first":
        picked.sort(key=lambda e: -e.contacts)
    elif choice.order == "outliers first":
        scores = outlier_scores(picked)
        picked.sort(key=lambda e: -scores[e.name])
    return picked


def outlier_scores(entries: Sequence[Entry]) -> dict[str, float]:
    """Return by name how far length or mean speed is from the median, in robust deviations."""
    result = dict.fromkeys((e.name for e in entries), 0.0)
    for values in ([e.length_m for e in entries], [e.speed_m_s for e in entries]):
        if not values:
            continue
        away = np.abs(np.array(values) - np.median(values))
        scale = 1.4826 * float(np.median(away)) or float(away.mean()) or 1.0
        for entry, distance in zip(entries, away / scale, strict=True):
            result[entry.name] = max(result[entry.name], float(distance))
    return result


def table_html(entries: Sequence[Entry], flagged: Collection[str], current: str) -> str:
    """Return the list as a table, its first `ROWS` rows."""
    scores = outlier_scores(entries)
    heads = "walk", "end", "m", "s", "m/s", "touched"
    cells = "".join(f"<th scope='col' style='text-align:left'>{h}</th>" for h in heads)
    lines = []
    for entry in entries[:ROWS]:
        mark = "⚑ " if entry.name in flagged else ""
        odd = " ⚠ outlier" if scores[entry.name] > 3.5 else ""
        bold = "font-weight:bold" if entry.name == current else ""
        values: tuple[Any, ...] = (
            f"{mark}{entry.name}{odd}",
            entry.outcome,
            f"{entry.length_m:.1f}",
            f"{entry.seconds:.0f}",
            f"{entry.speed_m_s:.2f}",
            f"{entry.contacts} ×" if entry.contacts else "",
        )
        wraps = ["overflow-wrap:anywhere", *["white-space:nowrap"] * (len(values) - 1)]
        row = "".join(
            f"<td style='padding-right:0.5em;{wrap}'>{html.escape(str(v))}</td>"
            for v, wrap in zip(values, wraps, strict=True)
        )
        lines.append(f"<tr style='{bold}'>{row}</tr>")
    more = f"<p>… and {len(entries) - ROWS} more</p>" if len(entries) > ROWS else ""
    count = f"{len(entries)} walk" + ("" if len(entries) == 1 else "s")
    return (
        "<div style='overflow-x:auto;padding:0 0.8em'>"
        "<table style='font-size:0.8em;border-spacing:0 2px'>"
        f"<caption style='text-align:left'>{count}</caption><tr>{cells}</tr>{''.join(lines)}"
        f"</table></div>{more}"
    )


def sheet(entries: Sequence[Entry], count: int = 12) -> U8:
    """Return the first and last picture of some entries as one picture, two entries a row."""
    tiles = []
    for entry in entries[:count]:
        ends = entry.ends()
        if ends is None:
            continue
        pair = [
            cv2.resize(picture, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA)
            for picture in ends
        ]
        tile = np.hstack(pair)
        band = np.full((18, tile.shape[1], 3), 255, np.uint8)
        text = f"{entry.name.rsplit('/', 1)[-1][-24:]} {entry.outcome}"
        cv2.putText(
            band, text, (3, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (20, 20, 20), 1, cv2.LINE_AA
        )
        tiles.append(np.vstack([band, tile]))
    if not tiles:
        return np.full((TILE_PX, 2 * TILE_PX, 3), 255, np.uint8)
    if len(tiles) % 2:
        tiles.append(np.full_like(tiles[0], 255))
    rows = [np.hstack(tiles[k : k + 2]) for k in range(0, len(tiles), 2)]
    return np.vstack(rows).astype(np.uint8)
