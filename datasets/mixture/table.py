"""The plan of a mixture as text and as JSON."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from .choice import DatasetRow
from .plan import MixturePlan

_HEAD = ("source", "dataset", "robot", "episodes", "frames", "weight", "share", "left out")


def plan_text(plan: MixturePlan) -> str:
    """Return a table in fixed columns: a line per dataset, with what was left out of it and why.

    Datasets that a source takes nothing from share a line. Sources of different paths are named
    beneath the table.
    """
    lines: list[tuple[str, ...]] = [_HEAD]
    for source in plan.sources:
        taken = [row for row in source.rows if row.episodes]
        for row in taken:
            share = source.share * _items(plan, (row,)) / _items(plan, source.rows)
            lines.append(
                (
                    source.name,
                    row.root.name,
                    row.robot,
                    str(row.episodes),
                    str(row.frames),
                    f"{source.weight:g}",
                    f"{100 * share:.1f} %",
                    _reasons([row]),
                )
            )
        others = [row for row in source.rows if not row.episodes]
        if others:
            name = f"({len(others)} other dataset{'s' * (len(others) > 1)})"
            lines.append((source.name, name, "", "0", "0", "", "", _reasons(others)))
    total = [row for source in plan.sources for row in source.rows]
    episodes, frames = sum(r.episodes for r in total), sum(r.frames for r in total)
    lines.append(("all", "", "", str(episodes), str(frames), "", "100.0 %", ""))
    widths = [max(len(line[k]) for line in lines) for k in range(len(_HEAD))]
    numbers = {3, 4, 5, 6}
    table = [
        "  ".join(
            cell.rjust(width) if k in numbers else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([*table, *_different_paths(plan)])


def _different_paths(plan: MixturePlan) -> list[str]:
    """Return a line that counts the paths of each source, unless all hold the same."""
    paths = {source.name: {*source.selection.trajectories()} for source in plan.sources}
    common = set.intersection(*paths.values())
    if all(own == common for own in paths.values()):
        return []
    counts = ", ".join(f"{name} {len(own)}" for name, own in paths.items())
    return [f"the sources hold different paths: {counts}; {len(common)} are in all of them"]


def plan_json(plan: MixturePlan) -> dict[str, Any]:
    """Return the same as JSON values."""
    return {
        "mixture": plan.name,
        "draws": plan.unit,
        "sources": [
            {
                "source": source.name,
                "weight": source.weight,
                "share": source.share,
                "episodes": len(source.selection),
                "frames": int(source.selection.lengths.sum()),
                "paths": len({*source.selection.trajectories()}),
                "datasets": [
                    {
                        "dataset": str(row.root),
                        "robot": row.robot,
                        "episodes": row.episodes,
                        "frames": row.frames,
                        "dropped": dict(row.dropped),
                    }
                    for row in source.rows
                ],
            }
            for source in plan.sources
        ],
    }


def _reasons(rows: Sequence[DatasetRow]) -> str:
    counts: Counter[str] = Counter()
    for row in rows:
        counts.update(row.dropped)
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items())) or "-"


def _items(plan: MixturePlan, rows: tuple[DatasetRow, ...]) -> int:
    return sum(row.episodes if plan.unit == "episodes" else row.frames for row in rows)
