"""Stage `scan`: generate the built-in apartment and scan it virtually."""

from __future__ import annotations

from pathlib import Path

from ..engine.work import WorkItem, work_item
from ..jobs.scan import ScanJob

STAGE = "scan"


def item(seed: int, folder: Path) -> WorkItem:
    """The work item that writes the apartment of `seed` into `folder`."""
    return work_item(STAGE, folder.name, ScanJob(seed, folder), (folder,), seed)
