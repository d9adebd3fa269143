"""The report page of an evaluation: results, films of every kind of ending, all episodes."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...evaluation.results import COLUMNS, COUNTS, decimals, grouped, summarise
from ..engine.ledger import Row
from .pictures import embedded_film, film_bytes, rendered_page

FILMS_BYTES = 24_000_000  # of all embedded films, base64 included
# Endings in the page's order, with their titles.
KINDS = {
    "success": "Successes: stopped within the goal's radius",
    "stopped_far": "Stopped too far from the goal",
    "fall": "Fell",
    "stuck": "Got stuck",
    "timeout": "Took 500 actions without a stop",
    "collision_start": "Started inside an obstacle",
}


def kind_of(facts: Mapping[str, Any]) -> str:
    """Return how an episode ended, a key of `KINDS`; success is VLN's, a stop within 3 m."""
    return "success" if facts["metrics"]["success"] else str(facts["end_reason"])


def policy_page(results: Mapping[str, Any], rows: Sequence[Row], films: Mapping[str, Path]) -> str:
    """Return the page as HTML.

    Args:
        films: by the rows' items, with the last frame beside each as `.jpg`.
    """
    kinds = Counter(kind_of(row.facts) for row in rows)
    return rendered_page(
        "policy.html.j2",
        setting=results["setting"],
        columns=[f"{name} [{unit}]" for name, (unit, _) in COLUMNS.items()],
        results=_result_rows(results["episodes"]),
        quarantined=results["quarantined"],
        doubts=_doubts(results["episodes"]),
        groups=_groups(rows, films, kinds),
        episodes=[_episode(row) for row in rows],
    )


def _doubts(episodes: Sequence[Mapping[str, Any]]) -> list[str]:
    totals = {what: sum(e.get(count, 0) for e in episodes) for count, what in COUNTS.items()}
    return [f"{total} {what}." for what, total in totals.items() if total]


def _result_rows(episodes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of the table of results: splits, all of them, scenes."""
    groups = list(grouped(episodes, "split").items())
    if len(groups) > 1:
        groups.append(("all", list(episodes)))
    scenes = grouped(episodes, "scene")
    if len(scenes) > 1:
        groups += scenes.items()
    return [
        {
            "name": name,
            "count": len(members),
            "cells": [vars(v) | {"decimals": decimals(n)} for n, v in summarise(members).items()],
        }
        for name, members in groups
    ]


def _groups(
    rows: Sequence[Row], films: Mapping[str, Path], kinds: Mapping[str, int]
) -> list[dict[str, Any]]:
    left, groups = FILMS_BYTES, []
    for kind, title in KINDS.items():
        if not kinds.get(kind):
            continue
        figures = []
        for row in rows:
            if kind_of(row.facts) != kind or row.item not in films:
                continue
            film = films[row.item]
            left -= film_bytes(film)
            shown = embedded_film(film) if left >= 0 else {"file": f"films/{film.name}"}
            figures.append(_episode(row) | shown)
        groups.append({"title": title, "count": kinds[kind], "figures": figures})
    return groups


def _episode(row: Row) -> dict[str, Any]:
    facts, metrics = row.facts, row.facts["metrics"]
    return {
        "name": f"{facts['scene']} / {facts['episode']}",
        "split": facts["split"],
        "instruction": facts["instruction"],
        "kind": kind_of(facts).replace("_", " "),
        "good": metrics["success"],
        "detail": facts["detail"],
        "ne": metrics["navigation_error_m"],
        "tl": metrics["trajectory_length_m"],
        "spl": 100 * (metrics["spl"] or 0.0),
        "seconds": metrics["duration_s"],
        "actions": len(facts["taken"]),
    }
