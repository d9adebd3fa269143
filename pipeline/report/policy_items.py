"""Stage `films` and the report page of an evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...collectors.robots import RobotSpec
from ...formats.core.atomic import atomic_file
from ...rendering.camera.views import View
from ...rendering.registry import scene_renderer_name
from ..engine.ledger import Row
from ..engine.work import WorkItem, work_item
from ..execution.runner import Context, run_stage
from ..stages.evaluation.film_job import PolicyFilmJob
from .policy_page import KINDS, kind_of, policy_page

STAGE = "films"
PAGE_NAME = "report.html"


def write(
    context: Context,
    rows: Sequence[Row],
    results: Mapping[str, Any],
    *,
    robot: RobotSpec,
    view: View,
    scenes: Path,
    films: int,
) -> Path:
    """Film some episodes of every kind of ending and write the report page; return the page."""
    items = film_items(rows, context.ledger.root, robot, view, scenes, films)
    done = run_stage(context, STAGE, list(items.values())).good()
    context.ledger.discard(STAGE, "")
    clips = {name: item.outputs[0] for name, item in items.items() if item.name in done}
    page = context.ledger.root / PAGE_NAME
    with atomic_file(page) as temporary:
        temporary.write_text(policy_page(results, rows, clips), encoding="utf-8")
    context.ledger.record([page])
    return page


def film_items(
    rows: Sequence[Row], root: Path, robot: RobotSpec, view: View, scenes: Path, films: int
) -> dict[str, WorkItem]:
    """Return films by the row's item: the first `films` of every kind, scenes in turn."""
    result: dict[str, WorkItem] = {}
    for kind in KINDS:
        for row in _spread([row for row in rows if kind_of(row.facts) == kind])[:films]:
            out = root / "films" / f"{row.item.replace('/', '-')}.mp4"
            scene, rollout = scenes / str(row.facts["scene"]), root / row.outputs[0]
            seen = replace(view, renderer=scene_renderer_name(scene, view.renderer))
            job = PolicyFilmJob(scene, rollout, robot, seen, out)
            outputs = (out, out.with_suffix(".jpg"))
            result[row.item] = work_item(STAGE, row.item, job, outputs, row.key, seen)
    return result


def _spread(rows: Sequence[Row]) -> list[Row]:
    """Return rows so that the first ones are of different scenes."""
    seen: dict[str, int] = {}
    ranked = []
    for row in rows:
        scene = str(row.facts["scene"])
        seen[scene] = seen.get(scene, 0) + 1
        ranked.append((seen[scene], row.item, row))
    return [row for *_, row in sorted(ranked, key=lambda entry: entry[:2])]
