"""The output of commands that have finished."""

import json
import logging
import os
import shlex
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..formats.core.checkout import find_uv
from ..formats.core.rollout import HUMAN
from .engine.ledger import Ledger
from .engine.run_folder import RunFolder
from .execution.runner import StageSummary
from .inputs.robot_copies import robot_of_run
from .options.collect import Collect
from .options.command_line import command_line
from .report.gather import LeftOut, RobotRow, left_out, robot_rows, shared_paths_note

log = logging.getLogger(__name__)
LEGEND = (
    "collected: ended within 0.25 m of the goal; SR: stopped within 3 m of it; OS: passed\n"
    "within 3 m; SPL: SR weighted by path length; nDTW: likeness of path and walk [%];\n"
    "NE: mean distance to the goal at the end; TL: mean length walked."
)
DRIVEN = "A person (human) ends within 1 m of the goal."
BENEATH = "Beneath a robot: how many of its paths did not go well; touched: an obstacle."
# The widest name of a robot, and of a controller: the table fits 100 characters.
ROBOT_WIDTH, CONTROLLER_WIDTH = 13, 26
MOST_NAMES = 12  # datasets that have a line
LEROBOT = "lerobot[dataset,viz]==0.6.1"
REMOTE = "no display here: --mode distant serves it at ports 9090 and 9876"


def show_summary(
    folder: RunFolder, summaries: Sequence[StageSummary], page: Path, options: Collect
) -> int:
    """Print the closing table, or one JSON object; return the exit code.

    0: done; 1: more items are quarantined than `options.max_failed` allows.
    """
    quarantined = sum(s.quarantined for s in summaries)
    ledger = Ledger(folder.root)
    rows, absent = robot_rows(ledger), left_out(ledger)
    again = [_walked_too(crew, options, folder.root) for crew in absent]
    code = int(quarantined > options.max_failed)
    if options.json:
        value = {
            "out": str(folder.root),
            "report": str(page),
            "stages": {s.stage: s.counts() for s in joined(summaries)},
            "robots": [vars(r) for r in rows],
            "left_out": [
                {**vars(crew), "command": command}
                for crew, command in zip(absent, again, strict=True)
            ],
            "quarantined": quarantined,
            "exit_code": code,
        }
        sys.stdout.write(json.dumps(value, allow_nan=False) + "\n")
        return code
    sys.stdout.write("\n" + stage_table(summaries) + "\n\n" + robot_table(rows) + "\n")
    if rows:
        sys.stdout.write(
            "\n".join([*textwrap.wrap(shared_paths_note(ledger), 78), legend(rows)]) + "\n"
        )
    sys.stdout.write("\n")
    for crew, command in zip(absent, again, strict=True):
        sys.stdout.write(
            f"Left out: {crew.robot} {crew.controller}, {crew.paths} paths. It walked other paths, "
            "or another version\nmade it; its data stays in the folder. To have it walk these "
            f"paths, too:\n  {command}\n\n"
        )
    sys.stdout.write(looking_commands(ledger, page) + "\n")
    if code:
        path = folder.root / "quarantine.json"
        sys.stdout.write(
            f"\n{quarantined} items were quarantined; see {path} for the reasons. The others are "
            "kept;\nthe same command with --retry-quarantined runs these again\n"
        )
    return code


def _walked_too(crew: LeftOut, options: Collect, root: Path) -> str:
    """Return the command by which a robot that was left out walks this run's paths."""
    timing = (
        {"action_steps": crew.actions["steps"], "closed_loop": crew.actions["closed_loop"]}
        if crew.actions
        else {}
    )
    robot = robot_of_run(crew.robot, root)
    who = {"robot": str(robot.folder or robot.name), "controller": crew.controller}
    return command_line(replace(options, **who, **timing))


def print_stages(
    options: Any,
    summaries: Sequence[StageSummary],
    text: str,
    *,
    failed: bool = False,
    **facts: Any,
) -> int:
    """Print the table of stages above a text, or one JSON object; return the exit code.

    It is 1 if the command has failed or more items are quarantined than `max_failed` allows.
    """
    quarantined = sum(summary.quarantined for summary in summaries)
    code = int(failed or quarantined > options.max_failed)
    stages = {summary.stage: summary.counts() for summary in joined(summaries)}
    counts = {"stages": stages, "quarantined": quarantined, "exit_code": code}
    print_result(options, facts | counts, f"\n{stage_table(summaries)}\n\n{text}")
    return code


def joined(summaries: Sequence[StageSummary]) -> list[StageSummary]:
    """Return one summary per stage, over all robots, in the order they ran."""
    stages: dict[str, StageSummary] = {}
    for summary in summaries:
        earlier = stages.get(summary.stage)
        stages[summary.stage] = earlier.joined(summary) if earlier else summary
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


def legend(rows: Sequence[RobotRow]) -> str:
    """Return what the columns of `robot_table` mean, and of its other lines what it has."""
    human = any(row.controller == HUMAN for row in rows)
    troubled = any(map(_troubles, rows))
    return "\n".join([LEGEND, *[DRIVEN] * human, *[BENEATH] * troubled])


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
        "stopped near": r.stopped_near,
        "stopped far": r.stopped_far,
        "blocked at the start": r.blocked_starts,
        "touched": r.collisions,
        "diverged": r.diverged,
    }
    return ", ".join(f"{count} {what}" for what, count in counts.items() if count)


def _number(value: float | None, width: int, digits: int) -> str:
    return f"{'–':>{width}}" if value is None else f"{value:>{width}.{digits}f}"


def looking_commands(ledger: Ledger, page: Path) -> str:
    """Return the commands that show the result: LeRobot's viewer, Foxglove, the report."""
    datasets = [ledger.root / row.outputs[0] for row in ledger.done("dataset")]
    episodes: dict[Path, list[Path]] = {}  # by dataset
    for row in ledger.done("mcap"):
        file = ledger.root / row.outputs[0]
        episodes.setdefault(file.parent, []).append(file)
    uvx = f"{find_uv('uvx') or 'uvx'} --python {shlex.quote(sys.executable)}"
    viewers = [
        f"{uvx} --from '{LEROBOT}' lerobot-dataset-viz --repo-id vlnpe/{data.name} "
        f"--root {shlex.quote(str(data))} --episode-index 0"
        for data in datasets
    ]
    players = [f"foxglove-studio {shlex.quote(str(files[0]))}" for files in episodes.values()]
    if players:
        players[0] += "   (or drop it on app.foxglove.dev)"
    further = sum(map(len, episodes.values())) - len(players)
    lines = ["View the results:", *_listed("LeRobot", viewers)]
    if viewers and not has_display():
        lines.append(f"{'':<12}({REMOTE})")
    lines += _listed("Foxglove", players)
    if further > 0:
        beside = "it" if len(players) == 1 else "these"
        lines.append(f"            and {further} more beside {beside}")
    lines.append(f"  report    python3 -m webbrowser {shlex.quote(page.as_uri())}")
    return "\n".join(lines)


def has_display() -> bool:
    """Return whether a viewer can open a window here."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    return sys.platform != "linux" or any(os.environ.get(name) for name in displays)


def _listed(name: str, commands: Sequence[str]) -> list[str]:
    """Return commands below each other, the first after a name; of very many the first ones."""
    shown = [f"  {name if k == 0 else '':<10}{command}" for k, command in enumerate(commands)]
    more = len(commands) - MOST_NAMES
    return shown[:MOST_NAMES] + ([f"{'':<12}… and {more} more datasets"] if more > 0 else [])


def print_result(options: Any, facts: dict[str, Any], text: str) -> int:
    """Print `text` or, with `--json`, one JSON object; return 0."""
    out = {"out": str(path)} if (path := getattr(options, "out", None)) is not None else {}
    sys.stdout.write((json.dumps(out | facts) if options.json else text) + "\n")
    return 0
