"""Stage `report`: the page that shows a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ...formats.core.atomic import write_bytes
from ..engine.keys import code_version, digest
from ..engine.run_folder import RunFolder
from ..engine.runner import Context, ItemResult, StageSummary, WorkItem, run_stage
from ..report.build import build_page
from ..report.gather import replay_rows
from . import pictures

STAGE = "report"
PAGE = "index.html"


def write(folder: RunFolder, context: Context, summaries: list[StageSummary]) -> Path:
    """Bring the report up to date with the ledger; returns the page."""
    ledger = context.ledger
    made, summary = pictures.make(folder, context, replay_rows(ledger))
    page = folder.report / PAGE
    shown = [row for row in ledger.rows() if row.stage != STAGE]
    # The page shows outcomes, not only what was done: a mended item keeps its key.
    content = [replace(row, seconds=0.0) for row in shown]
    code = code_version("pipeline/report", "pipeline/stages/report.py", "formats")
    key = digest(STAGE, content, code)
    item = WorkItem(PAGE, key, (page,), process, (folder.root, made, page))
    summaries += [summary, run_stage(context, STAGE, [item])]
    return page


def process(root: Path, made: pictures.Pictures, out: Path) -> ItemResult:
    """Write the page."""
    text = build_page(root, made)
    write_bytes(out, text.encode())
    return ItemResult({"bytes": len(text.encode())})
