"""The report's failures: what went wrong, and a clip of how."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from ..engine.ledger import Row
from .pictures import embedded_film, film_bytes

# Base64 included. A page of this size still opens at once, and holds about 150 clips.
CLIPS_BYTES = 16_000_000

REASONS = {
    "fall": "fell",
    "stuck": "got stuck",
    "timeout": "took too long",
    "stopped_near": "stopped near the goal",
    "stopped_far": "stopped away from the goal",
    "collision_start": "started inside an obstacle",
}


def failure_figures(
    rows: Sequence[Row],
    diverged: Sequence[Row],
    clips: Mapping[str, Path],
    budget_bytes: int = CLIPS_BYTES,
) -> list[dict[str, Any]]:
    """Return template values of every failed episode.

    Clips are embedded as long as they fit into the budget, one robot after the other in turn, so
    that none uses it up; for the others, the path of the file is given.

    Args:
        rows: rollouts of the replay stage.
        diverged: Episodes without a rollout.
        clips: by the rows' items, with the last frame beside each as `.jpg`.
        budget_bytes: of all embedded clips and pictures.
    """
    failed = [row for row in rows if row.failed]
    embedded = _within(_in_turn(failed), clips, budget_bytes)
    figures = [_figure(row, clips.get(row.item), row.item in embedded) for row in failed]
    for row in diverged:
        robot, controller, episode = row.item.split("/", 2)
        figures.append(
            {
                "episode": episode,
                "who": f"{robot}, {controller}",
                "what": "diverged",
                "detail": row.error["reason"],
            }
        )
    return figures


def _figure(row: Row, clip: Path | None, embedded: bool) -> dict[str, Any]:
    facts, metrics = row.facts, row.facts["metrics"]
    far = f"{metrics['navigation_error_euclidean_m']:.2f} m from it"
    figure = {
        "episode": facts["episode"],
        "who": f"{facts['robot']}, {facts['controller']}",
        "what": REASONS[facts["end_reason"]],
        "detail": far if facts["end_reason"].startswith("stopped") else facts["detail"],
        "seconds": metrics["duration_s"],
        "file": f"clips/{clip.name}" if clip else "",
    }
    return figure | embedded_film(clip) if clip and embedded else figure


def _in_turn(rows: Sequence[Row]) -> list[Row]:
    """Return one of each robot and controller, then the next of each, and so on."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.item.rsplit("/", 1)[0], []).append(row)
    return [row for turn in zip_longest(*groups.values()) for row in turn if row is not None]


def _within(rows: Sequence[Row], clips: Mapping[str, Path], budget_bytes: int) -> set[str]:
    left, chosen = budget_bytes, set()
    for row in rows:
        if row.item in clips:
            left -= film_bytes(clips[row.item])
            if left < 0:
                break
            chosen.add(row.item)
    return chosen
