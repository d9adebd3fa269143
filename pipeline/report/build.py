"""Puts the report page together from a run folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, select_autoescape

from ..ledger import Ledger, Row
from .gather import replay_rows, robot_rows
from .images import data_uri
from .maps import ScenePaths, map_figure
from .plots import histogram


def build_page(root: Path, maps: Mapping[str, Path], strips: Mapping[str, Path]) -> str:
    """The report's HTML.

    Args:
        root: the run folder.
        maps: scene/level → map picture with its mapping beside it, see `maps.map_figure`.
        strips: `robot/controller` → film strip.
    """
    ledger = Ledger(root)
    rows = replay_rows(ledger)
    paths = ScenePaths.load(root, rows)
    robots = robot_rows(ledger)
    quarantine = [r for r in ledger.rows() if r.status == "quarantined"]
    environment = Environment(
        loader=PackageLoader("vlnpe.pipeline.report", "."),
        autoescape=select_autoescape(default_for_string=True, default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("page.html.j2").render(
        title=root.name,
        version=version("vlnpe"),
        robots=sorted({r.robot for r in robots}),
        cards=_cards(rows, quarantine),
        robot_rows=robots,
        strips=[_strip(name, picture) for name, picture in sorted(strips.items())],
        maps=[map_figure(name, picture, paths) for name, picture in sorted(maps.items())],
        plots=_plots(paths),
        episode_note=_episode_note(ledger),
        episodes=[_episode(row, paths) for row in rows],
        scenes=[_scene(root, row) for row in ledger.rows("repair") if row.status == "done"],
        quarantine=[
            {"stage": r.stage, "item": r.item, "reason": r.error["reason"]} for r in quarantine
        ],
    )


def _cards(rows: Sequence[Row], quarantine: Sequence[Row]) -> list[dict[str, Any]]:
    def count(reason: str) -> int:
        return sum(r.facts["end_reason"] == reason for r in rows)

    walked = sum(r.facts["metrics"]["trajectory_length_m"] for r in rows)
    good, falls, stuck = count("success"), count("fall"), count("stuck")
    return [
        {"label": "episodes walked", "value": len(rows), "tone": ""},
        {"label": "collected", "value": good, "tone": "good" if good == len(rows) else "warn"},
        {"label": "falls", "value": falls, "tone": "bad" if falls else ""},
        {"label": "stuck", "value": stuck, "tone": "bad" if stuck else ""},
        {"label": "metres walked", "value": f"{walked:.0f}", "tone": ""},
        {
            "label": "quarantined",
            "value": len(quarantine),
            "tone": "bad" if quarantine else "",
        },
    ]


def _strip(name: str, picture: Path) -> dict[str, str]:
    robot, controller = name.split("/")
    return {
        "title": f"{robot}, {controller} controller",
        "image": data_uri(picture, maximum_width_px=4000),
        "caption": "One episode from start to goal: what it saw, how far, and how it walked.",
    }


def _plots(paths: ScenePaths) -> list[Any]:
    episodes = list(paths.episodes.values())
    return [
        histogram(
            [e.reference_length_m for e in episodes],
            "reference path [m]",
            "Length of the reference paths.",
        ),
        histogram(
            [len(e.instruction.split()) for e in episodes],
            "words",
            "Length of the instructions.",
        ),
    ]


def _episode_note(ledger: Ledger) -> str:
    parts = []
    for row in ledger.rows("sample"):
        dropped = {k: v for k, v in row.facts.get("dropped", {}).items() if v}
        reasons = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in sorted(dropped.items()))
        parts.append(
            f"{row.item}: {row.facts.get('episodes', 0)} sampled"
            + (f" (candidates dropped: {reasons})" if reasons else "")
        )
    for row in ledger.rows("filter"):
        kept, dropped = row.facts.get("kept", 0), row.facts.get("dropped", 0)
        parts.append(f"{row.item}: {kept} kept, {dropped} dropped for stairs")
    for row in ledger.rows("align"):
        if row.status == "done":
            moved = row.facts["moved"]
            parts.append(f"{row.item}: {row.facts['episodes']} aligned, {moved} starts moved")
    return ". ".join(parts) + "." if parts else ""


def _episode(row: Row, paths: ScenePaths) -> dict[str, Any]:
    facts = row.facts
    metrics = facts["metrics"]
    episode = paths.episodes[facts["episode"]]
    return {
        "id": facts["episode"],
        "scene": facts["scene"],
        "robot": facts["robot"],
        "controller": facts["controller"],
        "outcome": facts["end_reason"],
        "path": episode.reference_length_m,
        "tl": metrics["trajectory_length_m"],
        "ne": metrics["navigation_error_m"],
        "spl": 100 * (metrics["spl"] or 0.0),
        "ndtw": 100 * (metrics["ndtw"] or 0.0),
        "seconds": metrics["duration_s"],
        "instruction": episode.instruction,
    }


def _scene(root: Path, row: Row) -> dict[str, Any]:
    folder = root / "scenes" / row.item
    return {
        "name": row.item,
        "facts": _repair_note(row.facts),
        "before": data_uri(folder / "before.png", 1200),
        "after": data_uri(folder / "after.png", 1200),
    }


def _repair_note(facts: Mapping[str, Any]) -> str:
    left = ", ".join(f"{n} {cause}" for cause, n in sorted(facts["holes_left"].items()))
    levels = "1 level" if facts["levels"] == 1 else f"{facts['levels']} levels"
    text = (
        f"{levels}, {facts['triangles']:,} triangles. {facts['holes_filled']} holes filled: floor "
    )
    text += f"{facts['floor_before_m2']:.1f} m² before, {facts['floor_after_m2']:.1f} m² after."
    if left:
        text += f" Left open: {left}."
    return " ".join([text, *(f"{w.rstrip('.')}." for w in facts["warnings"])])
