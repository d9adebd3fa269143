"""Build the report page of a run folder."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...formats.core.checkout import CHECKOUT, program_in_checkout
from ...formats.trainers.answers import KINDS
from ..engine.ledger import Ledger, Row
from ..stages.episodes.align_items import filter_lines
from .dataset import dataset_plots, dataset_rows, texts_of
from .failures import failure_figures
from .gather import (
    RobotRow,
    answer_counts,
    diverged_rows,
    driven,
    left_out,
    robot_rows,
    shared_paths_note,
)
from .maps import ScenePaths, Track, map_figure, path_name
from .pictures import STAGE as PICTURES_STAGE
from .pictures import Pictures, jpeg_uri, rendered_page


def build_page(root: Path, pictures: Pictures) -> str:
    """Return the report of the run in `root` as HTML."""
    ledger = Ledger(root)
    rows = ledger.done("replay")
    paths = ScenePaths.load(root, rows)
    robots = robot_rows(ledger)
    quarantine = [r for r in ledger.rows() if r.status == "quarantined"]
    return rendered_page(
        "page.html.j2",
        title=root.name,
        program=program_in_checkout(),
        folder=_shown_folder(root),
        robots=sorted({r.robot for r in robots}),
        colors=paths.robots,
        cards=_cards(rows, robots, quarantine),
        robot_rows=robots,
        shared_paths_note=shared_paths_note(ledger),
        left_out=left_out(ledger),
        touched=_touched(rows, paths),
        failures=failure_figures(rows, diverged_rows(ledger), pictures.clips),
        datasets=[_dataset(name, picture, ledger) for name, picture in pictures.strips.items()],
        layouts=answer_counts(ledger.done()),
        kinds=KINDS,
        maps=[map_figure(name, picture, paths) for name, picture in sorted(pictures.maps.items())],
        plots=dataset_plots(list(paths.episodes.values())),
        splits=dataset_rows(list(paths.episodes.values())),
        episode_note=_episode_note(ledger, len(paths.episodes)),
        episodes=_episodes(rows, paths),
        scenes=[_scene(root, row) for row in ledger.done("repair")],
        quarantine=[
            {"stage": r.stage, "item": r.item, "reason": r.error["reason"]} for r in quarantine
        ],
    )


def _shown_folder(root: Path) -> str:
    """Return the run's folder as a shell in the checkout names it, or just its name."""
    root = root.resolve()
    return shlex.quote(
        str(root.relative_to(CHECKOUT) if root.is_relative_to(CHECKOUT) else root.name)
    )


def _cards(
    rows: Sequence[Row], robots: Sequence[RobotRow], quarantine: Sequence[Row]
) -> list[dict[str, Any]]:
    ends = Counter(row.facts["end_reason"] for row in rows)
    tried = sum(r.episodes for r in robots)
    walked = sum(r.facts["metrics"]["trajectory_length_m"] for r in rows)
    good = ends["success"]
    cards = [
        ("episodes walked", tried, ""),
        ("collected", good, "good" if good == tried else "warn"),
        ("falls", ends["fall"], "bad" if ends["fall"] else ""),
        ("stuck", ends["stuck"], "bad" if ends["stuck"] else ""),
        ("metres walked", f"{walked:,.0f}", ""),
        ("quarantined", len(quarantine), "bad" if quarantine else ""),
    ]
    return [{"label": label, "value": value, "tone": tone} for label, value, tone in cards]


def _dataset(name: str, picture: Path, ledger: Ledger) -> dict[str, Any]:
    strip = ledger.row(PICTURES_STAGE, f"strip {name}")
    dataset = ledger.row("dataset", name)
    assert strip is not None  # the picture is one of this stage
    return {
        "name": name,
        "image": jpeg_uri(picture, maximum_width_px=4000),
        "strip": strip.facts,
        "contents": dataset.facts if dataset is not None and dataset.status == "done" else None,
    }


def _episode_note(ledger: Ledger, walked: int) -> str:
    parts, sampled = [], ledger.rows("sample")
    for row in sampled:
        dropped = {k: v for k, v in row.facts.get("dropped", {}).items() if v}
        reasons = ", ".join(f"{v} {k.replace('_', ' ')}" for k, v in sorted(dropped.items()))
        parts.append(
            f"{row.item}: {row.facts.get('episodes', 0)} sampled"
            + (f" (candidates dropped: {reasons})" if reasons else "")
        )
    if sampled and walked > sum(row.facts.get("episodes", 0) for row in sampled):
        parts.append(f"{walked} paths were walked: some are of earlier runs in this folder")
    for row in ledger.rows("filter"):
        if "counts" in row.facts:
            parts += [line.strip() for line in filter_lines(row.facts)]
    for row in ledger.done("align"):
        facts = row.facts
        changed = ", ".join(f"{n} {what}" for what, n in facts.get("changed", {}).items() if n)
        of = f"{facts['episodes']} episodes of {facts.get('paths', '?')} paths"
        note = f"{row.item}: {of} aligned"
        parts.append(f"{note} ({changed})" if changed else note)
    return ". ".join(parts) + "." if parts else ""


def _episodes(rows: Sequence[Row], paths: ScenePaths) -> list[dict[str, Any]]:
    """Return every episode with each robot's outcome."""
    walks: dict[str, list[dict[str, Any]]] = {}
    for row, track in zip(rows, paths.tracks, strict=True):
        walks.setdefault(path_name(row), []).append(_walk(row, track))
    return [
        {
            "anchor": name,
            "id": episode.episode_id,
            "split": episode.split,
            # Its own is not the first where each text is an episode.
            "more_texts": [text for text in texts_of(episode) if text != episode.instruction],
            "path": episode.reference_length_m,
            "shortest": episode.geodesic_distance_m,
            "instruction": episode.instruction,
            "walks": walks[name],
        }
        for name, episode in sorted(paths.episodes.items())
    ]


def _touched(rows: Sequence[Row], paths: ScenePaths) -> dict[str, list[dict[str, str]]]:
    """Return by crew the episodes in which an obstacle was touched, with the robot's parts."""
    touched: dict[str, list[dict[str, str]]] = {}
    for row, track in zip(rows, paths.tracks, strict=True):
        if row.facts["contacts"]:
            crew, _ = row.item.rsplit("/", 1)
            entry = {"anchor": path_name(row), "id": row.facts["episode"], "parts": track.touching}
            touched.setdefault(crew, []).append(entry)
    return touched


def _walk(row: Row, track: Track) -> dict[str, Any]:
    facts, metrics = row.facts, row.facts["metrics"]
    return {
        "robot": facts["robot"],
        "controller": driven(facts["controller"], [facts], with_seed=bool(facts.get("seed"))),
        "outcome": facts["end_reason"],
        "tl": metrics["trajectory_length_m"],
        "off": track.off_path_m,
        "ne": metrics["navigation_error_m"],
        "spl": 100 * (metrics["spl"] or 0.0),
        "ndtw": 100 * (metrics["ndtw"] or 0.0),
        "seconds": metrics["duration_s"],
    }


def _scene(root: Path, row: Row) -> dict[str, Any]:
    folder = root / "scenes" / row.item
    return {
        "name": row.item,
        "facts": _repair_note(row.facts),
        "problems": row.facts.get("problems", ()),
        "before": jpeg_uri(folder / "before.png", 1200),
        "after": jpeg_uri(folder / "after.png", 1200),
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
    notes = [*facts.get("doubts", ()), *facts["warnings"]]
    return " ".join([text, *(f"{note.rstrip('.')}." for note in notes)])
