"""Stage `scan`: generate built-in scenes and scan them virtually."""

from __future__ import annotations

from pathlib import Path

from ..builtin import BuiltIn
from ..engine.work import WorkItem, work_item
from ..jobs.scan import ScanJob

STAGE = "scan"


def item(building: BuiltIn, folder: Path) -> WorkItem:
    """The work item that writes a generated building's scan into `folder`."""
    job = ScanJob(building.seed, folder, building.kind)
    return work_item(STAGE, building.name, job, (folder,), building.seed, building.kind)
