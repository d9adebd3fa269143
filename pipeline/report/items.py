"""Stages `pictures` and `report`: the page that shows a run."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...collectors.robots import RobotSpec
from ..engine.ledger import Ledger, Row
from ..engine.run_folder import RunFolder
from ..engine.work import WorkItem, work_item
from ..execution.runner import Context, StageSummary, run_stage
from ..inputs.robot_copies import robot_of_run
from ..stages.rollouts import render_items as render
from ..stages.rollouts.pictures_job import ClipJob, MapJob, StripJob
from .gather import left_out
from .job import ReportJob
from .pictures import STAGE as PICTURES_STAGE
from .pictures import Pictures

log = logging.getLogger(__name__)

STAGE = "report"
CLIP_S = 5.0  # how much of a failure's end is shown
PAGE = "index.html"
TIMES = {"cpu_s", "seconds"}  # facts about how long work took


def write(folder: RunFolder, context: Context, summaries: list[StageSummary]) -> Path:
    """Write the report of the ledger's current state; return the page."""
    ledger = context.ledger
    pictures, summary = _pictures(folder, context, ledger.done("replay"))
    page = folder.report / PAGE
    shown = [row for row in ledger.rows() if row.stage != STAGE]
    # The page shows outcomes, not only what was done: a repaired item keeps its key.
    content = [*map(_untimed, shown), *left_out(ledger)]
    item = work_item(STAGE, PAGE, ReportJob(folder.root, pictures, page), (page,), content=content)
    summaries += [summary, run_stage(context, STAGE, [item])]
    return page


def _untimed(row: Row) -> Row:
    """Return a row without what differs from one run to the next of the same work."""
    facts = {key: value for key, value in row.facts.items() if key not in TIMES}
    return replace(row, seconds=0.0, cpu_seconds=0.0, compile_seconds=0.0, facts=facts)


def _pictures(
    folder: RunFolder, context: Context, rows: Sequence[Row]
) -> tuple[Pictures, StageSummary]:
    """Make the missing images and clips of the replay stage's `rows`."""
    kinds = (
        _map_items(folder, context.ledger),
        strip_items(folder, context.ledger, rows),
        _clip_items(folder, context.ledger, rows),
    )
    summary = run_stage(
        context, PICTURES_STAGE, [item for items in kinds for item in items.values()]
    )
    for kind in ("clip ", "strip "):
        context.ledger.discard(PICTURES_STAGE, kind)
    good = summary.good()
    outputs = (
        {name: item.outputs[0] for name, item in items.items() if item.name in good}
        for items in kinds
    )
    return Pictures(*outputs), summary


def _map_items(folder: RunFolder, ledger: Ledger) -> dict[str, WorkItem]:
    result = {}
    for row in ledger.done("repair"):
        for level in range(int(row.facts["levels"])):
            name = f"{row.item}/{level}"
            out = folder.report / "maps" / f"{row.item}-{level}.png"
            job = MapJob(folder.scenes / row.item, level, out)
            outputs = (out, out.with_suffix(".json"))
            result[name] = work_item(
                PICTURES_STAGE, f"map {name}", job, outputs, row.key, level=level
            )
    return result


def strip_items(folder: RunFolder, ledger: Ledger, rows: Sequence[Row]) -> dict[str, WorkItem]:
    """Return one strip per dataset, of the episode that most robots completed where possible."""
    solved = Counter(row.facts["episode"] for row in rows if not row.failed)
    rollouts = {row.item: row for row in rows}
    candidates: dict[str, list[tuple[Row, Row]]] = {}
    for frames in ledger.done(render.STAGE):
        robot, controller, view, episode = frames.item.split("/", 3)
        row = rollouts.get(f"{robot}/{controller}/{episode}")
        if row is not None:
            candidates.setdefault(f"{robot}-{controller}-{view}", []).append((row, frames))

    def rank(pair: tuple[Row, Row]) -> tuple[bool, int, str]:
        row, _ = pair
        return row.failed, -solved[row.facts["episode"]], row.item

    result = {}
    for name, pairs in candidates.items():
        out = folder.report / "strips" / f"{name}.jpg"
        drawn = ledger.row(PICTURES_STAGE, f"strip {name}")
        for row, frames in sorted(pairs, key=rank):
            job = StripJob(*_paths(folder, row), folder.root / frames.outputs[0], out)
            inputs = (frames.key, _scene_key(ledger, row))
            item = work_item(PICTURES_STAGE, f"strip {name}", job, (out,), *inputs)
            # Frames may have been deleted by hand once their dataset was written.
            if job.frames.is_dir() or (drawn and drawn.key == item.key and out.is_file()):
                result[name] = item
                break
        else:
            log.warning("%s: its frames are gone, so the report does not show it", name)
    return result


def _clip_items(folder: RunFolder, ledger: Ledger, rows: Sequence[Row]) -> dict[str, WorkItem]:
    """Return one clip per failed episode."""
    result = {}
    for row in rows:
        if not row.failed:
            continue
        out = folder.report / "clips" / f"{row.item}.mp4"
        job = ClipJob(*_paths(folder, row), CLIP_S, out)
        outputs = (out, out.with_suffix(".jpg"))
        inputs = (row.key, _scene_key(ledger, row), CLIP_S)
        result[row.item] = work_item(PICTURES_STAGE, f"clip {row.item}", job, outputs, *inputs)
    return result


def _paths(folder: RunFolder, row: Row) -> tuple[Path, Path, RobotSpec]:
    """Return scene, rollout and robot of a row of the replay stage."""
    robot = robot_of_run(str(row.facts["robot"]), folder.root)
    return folder.scenes / str(row.facts["scene"]), folder.root / row.outputs[0], robot


def _scene_key(ledger: Ledger, row: Row) -> str:
    scene = ledger.row("repair", str(row.facts["scene"]))
    return scene.key if scene else ""
