"""Options of the commands that run many items."""

from __future__ import annotations

from dataclasses import dataclass

from .execution import Executed


@dataclass(frozen=True, kw_only=True)
class Running(Executed):
    """How items are run."""

    max_failed: int = 0
    """Maximum number of quarantined items; exit with code 1 above it."""
    wait: bool = False
    """If another process works in the output folder, wait for it to end instead of refusing."""
    explain: bool = False
    """Say of every item why it runs or is reused, on stderr."""
    retry_quarantined: bool = False
    """Run quarantined items again although nothing has changed that they depend on. Those that
    failed for want of memory, disk space or a server are run again anyway."""
    only: str = ""
    """Run one item alone, in this process, and print its traceback if it fails: STAGE:ITEM, as
    quarantine.json lists them. All that it depends on must be done."""
