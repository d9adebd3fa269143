"""Stage `scan`: generate the built-in apartment and scan it virtually."""

from __future__ import annotations

from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ..engine.keys import code_version, digest
from ..engine.runner import ItemResult, WorkItem

STAGE = "scan"


def item(seed: int, folder: Path) -> WorkItem:
    """The work item that writes the apartment of `seed` into `folder`."""
    code = code_version("apartments", "formats", "pipeline/stages/scans.py")
    key = digest(STAGE, seed, code)
    return WorkItem(folder.name, key, (folder,), process, (seed, folder))


def process(seed: int, folder: Path) -> ItemResult:
    """Generate one scan."""
    # Takes long to import: only where the work is done.
    from ...apartments import generate_scan

    with atomic_folder(folder) as temporary:
        scan = generate_scan(seed, temporary)
        size = scan.stat().st_size
        # The scan is made by this project, so that the data made from it may be used as freely.
        (temporary / "LICENSE.scan").write_text("Apache-2.0\n")
    return ItemResult({"seed": seed, "scan": scan.name, "bytes": size})
