"""Scores as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from .score import COUNTED_FROM_M, HoleScore, Score
from .shapes import KINDS

SIZES_M = (0.03, 0.05, 0.1, 0.2, 0.5, 1.0, 2.6)


def counted(scores: Iterable[Score]) -> list[HoleScore]:
    """Planted holes of at least 5 cm."""
    return [
        h
        for s in scores
        for h in s.holes
        if not h.hole.decoy and h.area_m2 > 0 and h.hole.size_m >= COUNTED_FROM_M
    ]


def summary(scores: Sequence[Score]) -> list[str]:
    """The figures that the targets speak of, as table rows."""
    holes, decoys = counted(scores), [h for s in scores for h in s.holes if h.hole.decoy]
    errors = 1000 * np.abs(np.concatenate([h.errors_m for h in holes] or [np.empty(0)]))
    natural = 1000 * np.abs(np.concatenate([s.natural_errors_m for s in scores]))
    floor = sum(s.floor_m2 for s in scores)
    area = sum(h.area_m2 for h in holes)
    filled = sum(h.filled_m2 for h in holes)
    whole = sum(h.filled for h in holes)
    rows = [
        ("planted holes of at least 5 cm", f"{len(holes)}, {area:.1f} m²", ""),
        ("planted area filled", f"{100 * filled / max(area, 1e-9):.2f} %", "≥ 99 %"),
        ("planted holes filled", f"{100 * whole / max(len(holes), 1):.2f} %", "≥ 98 %"),
        ("decoys filled", f"{sum(h.filled for h in decoys)} of {len(decoys)}", "0"),
        (
            "floor added outside the building",
            f"{100 * sum(s.outside_m2 for s in scores) / floor:.3f} % of the floor",
            "< 0.1 %",
        ),
        (
            "floor added under walls",
            f"{100 * sum(s.in_walls_m2 for s in scores) / floor:.3f} % of the floor",
            "",
        ),
    ]
    if len(errors):
        rows.append(("patch height error, median", f"{np.median(errors):.2f} mm", "< 5 mm"))
        rows.append(("… 99th percentile", f"{np.percentile(errors, 99):.1f} mm", "< 20 mm"))
    if len(natural):
        before = sum(s.before * s.floor_m2 for s in scores) / floor
        after = sum(s.after * s.floor_m2 for s in scores) / floor
        rows.append(
            (
                "true floor that is there, before and after",
                f"{100 * before:.2f} % → {100 * after:.2f} %",
                "",
            )
        )
        rows.append(
            (
                "height error in the scan's own gaps, median and 99th percentile",
                f"{np.median(natural):.2f} mm, {np.percentile(natural, 99):.1f} mm",
                "",
            )
        )
    rows.append(
        (
            "scan vertices moved, flattened bumps apart",
            f"{sum(s.moved for s in scores)} of {sum(s.vertices for s in scores):,}",
            "0",
        )
    )
    return [
        "| | measured | target |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {value} | {target} |" for name, value, target in rows),
    ]


def by_kind(scores: Sequence[Score]) -> list[str]:
    """A table of kinds, and one of sizes."""
    everything = [h for s in scores for h in s.holes if not h.hole.decoy and h.area_m2 > 0]
    lines = _group_table(
        "kind", [(kind, [h for h in everything if h.hole.kind == kind]) for kind in KINDS]
    )
    torn = [h for h in everything if h.hole.ragged]
    lines += _rows([("torn rims, of all kinds", torn)])
    bands = pairwise(SIZES_M)
    lines += [
        "",
        *_group_table(
            "longest side",
            [
                (
                    f"{100 * a:.0f} … {100 * b:.0f} cm",
                    [h for h in everything if a <= h.hole.size_m < b],
                )
                for a, b in bands
            ],
        ),
    ]
    return lines


def missed(scores: Sequence[Score]) -> list[str]:
    """Holes that stayed open, and decoys that were filled, with the repair's own reason."""
    rows = [
        f"| {s.scene} | {h.hole.name} | {_middle(h)} | {100 * h.hole.size_m:.0f} "
        f"| {1e4 * h.area_m2:.0f} "
        f"| {100 * h.share:.1f} | {h.reason} |"
        for s in scores
        for h in s.holes
        if h.area_m2 > 0 and h.filled == h.hole.decoy
    ]
    if not rows:
        return ["None."]
    return [
        "| scene | hole | at x, y | cm | cm² | % filled | what repair.json says |",
        "| --- | --- | ---: | ---: | ---: | ---: | --- |",
        *rows,
    ]


def _middle(score: HoleScore) -> str:
    lower, upper = score.hole.outline.bounds_m()
    x, y = (lower + upper) / 2
    return f"{x:.2f}, {y:.2f}"


def _group_table(title: str, groups: list[tuple[str, list[HoleScore]]]) -> list[str]:
    return [
        f"| {title} | holes | area, m² | area filled | holes filled | error, median | 99 % |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        *_rows(groups),
    ]


def _rows(groups: list[tuple[str, list[HoleScore]]]) -> list[str]:
    rows = []
    for name, holes in groups:
        if not holes:
            continue
        area, filled = sum(h.area_m2 for h in holes), sum(h.filled_m2 for h in holes)
        whole = sum(h.filled for h in holes) / len(holes)
        errors = 1000 * np.abs(np.concatenate([h.errors_m for h in holes]))
        middle, most = np.percentile(errors, [50, 99]) if len(errors) else (np.nan, np.nan)
        rows.append(
            f"| {name} | {len(holes)} | {area:.3f} | {100 * filled / area:.2f} % "
            f"| {100 * whole:.1f} % | {middle:.2f} mm | {most:.1f} mm |"
        )
    return rows
