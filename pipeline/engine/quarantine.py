"""What is kept of an item that failed: its traceback, and the command that runs it alone."""

from __future__ import annotations

import glob
import shlex
from dataclasses import replace
from pathlib import Path

from ...formats.core.atomic import write_bytes
from .ledger import Ledger, Row
from .run_folder import file_name
from .work import WorkItem

FOLDER = "quarantine"


def keep_failure(ledger: Ledger, row: Row, item: WorkItem, traceback: str, command: str) -> Row:
    """Write the traceback of a quarantined item.

    Args:
        ledger: Of the run.
        row: The item's row.
        item: The item.
        traceback: As Python prints it.
        command: The command line that runs one item alone, up to the item; empty if none does.

    Returns:
        The row, which names the file and the command.
    """
    path = _traceback(ledger, row.stage, item)
    error = {**row.error, "traceback": path.relative_to(ledger.root).as_posix()}
    lines = [f"{row.stage} {row.item}", f"reason: {row.error['reason']}"]
    if command:
        error["command"] = f"{command} --only {shlex.quote(f'{row.stage}:{row.item}')}"
        lines.append(f"to run it alone: {error['command']}")
    write_bytes(path, "\n".join([*lines, "", traceback]).encode())
    ledger.record([path, *_dumps(item)])
    return replace(row, error=error)


def forget_failure(ledger: Ledger, stage: str, item: WorkItem) -> None:
    """Remove the traceback of an item that is run again, if it was quarantined."""
    row = ledger.row(stage, item.name)
    if row is not None and row.status == "quarantined":
        path = _traceback(ledger, stage, item)
        path.unlink(missing_ok=True)
        ledger.unrecord([path, *_dumps(item)])


def _traceback(ledger: Ledger, stage: str, item: WorkItem) -> Path:
    return ledger.root / FOLDER / stage / f"{file_name(item.name)}.txt"


def _dumps(item: WorkItem) -> list[Path]:
    """Return what a failed job left beside its outputs, as the last state of diverged physics."""
    return [
        path
        for out in item.outputs
        for path in out.parent.glob(f"{glob.escape(out.stem)}.*")
        if path != out and path.is_file()
    ]
