"""Numbers of a run, read from its ledger."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from ..ledger import Ledger, Row


@dataclass(frozen=True)
class RobotRow:
    """Averages of one robot under one controller: metres for TL and NE, else percent.

    NE is over the episodes whose goal could still be reached from where they ended.

    `collected` counts episodes that ended within 0.25 m of the goal; SR, OS, SPL follow VLN-CE.
    """

    robot: str
    controller: str
    episodes: int
    collected: float
    tl: float
    ne: float | None
    os: float
    sr: float
    spl: float
    ndtw: float
    fr: float
    str: float


def replay_rows(ledger: Ledger) -> list[Row]:
    """Rows of rollouts that exist."""
    return [row for row in ledger.rows("replay") if row.status == "done"]


def robot_rows(ledger: Ledger) -> list[RobotRow]:
    """One row per robot and controller, in name order."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in replay_rows(ledger):
        facts = row.facts
        groups[(facts["robot"], facts["controller"])].append(facts)
    result = []
    for (robot, controller), facts in sorted(groups.items()):
        metrics = [f["metrics"] for f in facts]

        def percent(key: str, metrics: list[dict[str, Any]] = metrics) -> float:
            return 100 * fmean(m[key] or 0.0 for m in metrics)

        # An unreachable goal has no finite distance; it must not hide the others' mean.
        errors = [m["navigation_error_m"] for m in metrics if m["navigation_error_m"] is not None]
        result.append(
            RobotRow(
                robot=robot,
                controller=controller,
                episodes=len(facts),
                collected=100 * fmean(f["end_reason"] == "success" for f in facts),
                tl=fmean(m["trajectory_length_m"] for m in metrics),
                ne=fmean(errors) if errors else None,
                os=percent("oracle_success"),
                sr=percent("success"),
                spl=percent("spl"),
                ndtw=percent("ndtw"),
                fr=percent("fall"),
                str=percent("stuck"),
            )
        )
    return result
