"""Stage `report`: the page that shows a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..engine.run_folder import RunFolder
from ..engine.runner import Context, StageSummary, run_stage
from ..engine.work import work_item
from ..jobs.report import ReportJob
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
    item = work_item(STAGE, PAGE, ReportJob(folder.root, made, page), (page,), content)
    summaries += [summary, run_stage(context, STAGE, [item])]
    return page
