"""The record of an item that ran: its row, and the traceback and command of a failure."""

import errno
import glob
import logging
import os
import shlex
from dataclasses import replace
from pathlib import Path

from ...formats.core.atomic import write_bytes
from ...formats.core.errors import InputError, VlnpeError
from ..engine.explain import parts_of
from ..engine.files import Records
from ..engine.ledger import Ledger
from ..engine.rows import Row
from ..engine.run_folder import file_name
from ..engine.work import WorkItem
from .attempts import TRANSIENT, Outcome

log = logging.getLogger(__name__)

# The output folder itself is unusable: going on would fail every item for the same reason.
FATAL_ERRNO = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM}

FOLDER = "quarantine"


def record(ledger: Ledger, stage: str, item: WorkItem, outcome: Outcome, command: str) -> Row:
    """Write an item's row, and the traceback of a failure.

    Args:
        command: The command line that runs one item alone, up to its name; empty if none does.
    """
    row = _row(stage, item, outcome, ledger.root)
    if outcome.error is not None:
        row = _keep_failure(ledger, row, item, outcome.traceback, command)
    parts = parts_of(item.inputs, item.job)
    ledger.describe({part.digest: part.values for part in parts.values()})
    row = replace(row, parts={name: part.digest for name, part in parts.items()})
    ledger.add(row, _files(outcome, ledger.root))
    return row


def _row(stage: str, item: WorkItem, outcome: Outcome, root: Path) -> Row:
    error = outcome.error
    if error is None:
        return Row(
            stage,
            item.name,
            item.key,
            "done",
            failed=outcome.result.failed,
            outputs=tuple(os.path.relpath(p, root) for p in item.outputs),
            seconds=outcome.seconds,
            cpu_seconds=outcome.cpu_seconds,
            compile_seconds=outcome.compile_seconds,
            facts=outcome.result.facts,
        )
    if isinstance(error, OSError) and error.errno in FATAL_ERRNO:
        raise InputError(f"cannot use {error.filename or root}: {error.strerror}")
    log.debug("%s %s", item.name, outcome.traceback)
    reason = str(error) if isinstance(error, VlnpeError) else repr(error)
    described = {"type": type(error).__name__, "reason": reason}
    if isinstance(error, OSError | MemoryError) or type(error).__name__ in TRANSIENT:
        described["transient"] = "yes"
    return Row(stage, item.name, item.key, "quarantined", error=described)


def _files(outcome: Outcome, root: Path) -> dict[str, Records]:
    return {os.path.relpath(path, root): records for path, records in outcome.files.items()}


def _keep_failure(ledger: Ledger, row: Row, item: WorkItem, traceback: str, command: str) -> Row:
    """Write the traceback of a quarantined item; return its row with the file and the command."""
    path = _traceback(ledger, row.stage, item)
    error = {**row.error, "traceback": ledger.relative(path)}
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
