"""What commands print when they have finished."""

from __future__ import annotations

import json
import logging
import shlex
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

from ..formats.core.checkout import find_uv
from .engine.ledger import Ledger
from .engine.run_folder import RunFolder
from .engine.runner import StageSummary
from .report.gather import RobotRow, robot_rows

log = logging.getLogger(__name__)
LEGEND = (
    "collected: ended within 0.25 m of the goal; SR: stopped within 3 m of it; OS:\n"
    "passed within 3 m; SPL: SR weighted by path length; nDTW: likeness of path and\n"
    "walk [%]; NE: mean distance to the goal at the end; TL: mean length walked.\n"
    "Beneath a robot: how many of its paths did not go well; touched: an obstacle."
)
# The widest name of a robot, and of a controller: the table fits 100 characters.
ROBOT_WIDTH, CONTROLLER_WIDTH = 13, 26
MOST_NAMES = 12  # datasets that are listed
LEROBOT = "lerobot[dataset,viz]==0.6.1"


def show_summary(
    folder: RunFolder,
    summaries: Sequence[StageSummary],
    page: Path,
    max_failed: int,
    as_json: bool,
    stream: TextIO = sys.stdout,
) -> int:
    """Write the closing table, or one JSON object, to `stream`; return the exit code.

    0: done; 1: more items are quarantined than `max_failed` allows.
    """
    quarantined = sum(s.quarantined for s in summaries)
    rows = robot_rows(Ledger(folder.root))
    code = int(quarantined > max_failed)
    if as_json:
        value = {
            "out": str(folder.root),
            "report": str(page),
            "stages": {s.stage: s.counts() for s in joined(summaries)},
            "robots": [vars(r) for r in rows],
            "quarantined": quarantined,
            "exit_code": code,
        }
        stream.write(json.dumps(value, allow_nan=False) + "\n")
        return code
    stream.write("\n" + stage_table(summaries) + "\n\n" + robot_table(rows))
    stream.write(f"\n{LEGEND}\n\n" if rows else "\n\n")
    stream.write(looking_commands(folder, summaries, page) + "\n")
    if code:
        path = folder.root / "quarantine.json"
        stream.write(f"\n{quarantined} items were quarantined; see {path} for the reasons\n")
    return code


def joined(summaries: Sequence[StageSummary]) -> list[StageSummary]:
    """Return one summary per stage, over all robots, in the order they ran."""
    stages: dict[str, StageSummary] = {}
    for summary in summaries:
        known = stages.get(summary.stage)
        stages[summary.stage] = known.joined(summary) if known else summary
    return list(stages.values())


def stage_table(summaries: Sequence[StageSummary]) -> str:
    """Return one line per stage with its counts over all robots."""
    lines = [f"{'stage':<10}{'done':>7}{'reused':>8}{'failed':>8}{'quarantined':>13}{'seconds':>9}"]
    lines += [
        f"{s.stage:<10}{s.done:>7}{s.reused:>8}{s.failed:>8}{s.quarantined:>13}{s.seconds:>9.1f}"
        for s in joined(summaries)
    ]
    return "\n".join(lines)


def robot_table(rows: Sequence[RobotRow]) -> str:
    """Return one line per robot and controller, and one beneath if something went wrong."""
    robots = [elided(r.robot, ROBOT_WIDTH) for r in rows]
    controllers = [elided(r.driven, CONTROLLER_WIDTH) for r in rows]
    width = 1 + max([5, *map(len, robots)])
    wide = 1 + max([10, *map(len, controllers)])
    header = f"{'robot':<{width}}{'controller':<{wide}}{'paths':>6}{'texts':>6}{'collected':>10}"
    header += "".join(f"{name:>6}" for name in ("SR %", "OS %", "SPL %", "nDTW", "NE m"))
    lines = [f"{header}{'TL m':>7}"]
    for r, robot, controller in zip(rows, robots, controllers, strict=True):
        line = f"{robot:<{width}}{controller:<{wide}}{r.episodes:>6}{r.instructions:>6}"
        line += f"{r.collected:>9.1f}%"
        line += "".join(f"{v:>6.1f}" for v in (r.sr, r.os, r.spl))
        lines.append(line + _number(r.ndtw, 6, 1) + _number(r.ne, 6, 2) + _number(r.tl, 7, 2))
        if troubles := _troubles(r):
            lines += textwrap.wrap(troubles, 78, initial_indent="  ", subsequent_indent="  ")
    return "\n".join(lines)


def elided(name: str, most: int) -> str:
    """Return a name of at most `most` characters, without its middle where it is longer."""
    if len(name) <= most:
        return name
    end = (most - 1) // 2
    return f"{name[: most - 1 - end]}…{name[-end:]}"


def _troubles(r: RobotRow) -> str:
    counts = {
        f"fell ({r.down} down a second later)": r.falls,
        "stuck": r.stuck,
        "out of time": r.timeouts,
        "stopped far": r.stopped_far,
        "blocked at the start": r.blocked_starts,
        "touched": r.collisions,
        "diverged": r.diverged,
    }
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _number(value: float | None, width: int, digits: int) -> str:
    return f"{'–':>{width}}" if value is None else f"{value:>{width}.{digits}f}"


def looking_commands(folder: RunFolder, summaries: Sequence[StageSummary], page: Path) -> str:
    """Return the commands that show the result: LeRobot's viewer, Foxglove, the report."""
    made = [row for summary in summaries for row in summary.good().values()]
    datasets = [folder.root / row.outputs[0] for row in made if row.stage == "dataset"]
    episodes = [folder.root / row.outputs[0] for row in made if row.stage == "mcap"]
    uvx = f"{find_uv('uvx') or 'uvx'} --python {shlex.quote(sys.executable)}"
    lines = ["View the results:"]
    if datasets:
        data = datasets[0]
        lines.append(
            f"  LeRobot   {uvx} --from '{LEROBOT}' lerobot-dataset-viz"
            f" --repo-id vlnpe/{data.name} --root {shlex.quote(str(data))} --episode-index 0"
        )
        others = [path.name for path in datasets[1:]]
        if others:
            lines.append(f"            likewise, in {data.parent}:")
            lines += [f"              {name}" for name in others[:MOST_NAMES]]
        if len(others) > MOST_NAMES:
            lines.append(f"              … and {len(others) - MOST_NAMES} more")
    if episodes:
        file = shlex.quote(str(episodes[0]))
        lines.append(f"  Foxglove  foxglove-studio {file}   (or drop it on app.foxglove.dev)")
        if len(episodes) > 1:
            lines.append(f"            likewise the other {len(episodes) - 1} in {folder.mcap}")
    lines.append(f"  report    python3 -m webbrowser {shlex.quote(page.as_uri())}")
    return "\n".join(lines)


def print_result(options: Any, facts: dict[str, Any], text: str) -> int:
    """Print `text` or, with `--json`, one JSON object; return 0."""
    value = {**{k: str(v) for k, v in asdict(options).items() if k == "out"}, **facts}
    sys.stdout.write((json.dumps(value) if options.json else text) + "\n")
    return 0
