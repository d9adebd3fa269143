"""Open a ledger with worker processes: that of an output folder, or that of a single output."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from ...formats.core.atomic import TEMPORARY_PREFIX, sweep, write_bytes
from ...formats.core.errors import InputError, VlnpeError
from .executors import Execution, make_executor
from .ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger, Row
from .run_folder import open_run_folder
from .runner import Context, run_stage
from .work import WorkItem

LEDGERS = ".vlnpe"  # folder of the ledgers of single outputs, beside them
OUTPUT_NAME = "output.json"


@contextmanager
def open_context(root: Path, execution: Execution) -> Iterator[Context]:
    """Open an output folder with its ledger, and start what runs its items.

    Args:
        root: Output folder; created if it does not exist.
        execution: Where the items run.

    Raises:
        InputError: If the folder or the executor cannot be used.
    """
    new = not root.exists()
    ours = any((root / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME))
    if root.is_dir() and any(root.iterdir()) and not ours:
        raise InputError(
            f"output folder {root}: not empty and not an earlier run; choose another OUT"
        )
    folder = open_run_folder(root)
    sweep(folder.root)
    ledger = Ledger(folder.root)
    ledger.save()
    try:
        with closing(make_executor(execution, folder.root)) as executor:
            yield Context(ledger, executor)
    except InputError:
        left = {p.name for p in folder.root.rglob("*") if p.is_file()}
        if new and left <= {MANIFEST_NAME, QUARANTINE_NAME}:
            shutil.rmtree(folder.root)
        raise


@contextmanager
def open_single(out: Path, workers: int = 1) -> Iterator[Context]:
    """Open the ledger of one output, and start worker processes.

    For commands that run one stage and write the file or folder that the user names. The ledger
    lies beside it, in `.vlnpe/<name>/`, where a stage may also keep files to resume from.

    Args:
        out: File or folder that the command writes.
        workers: Number of worker processes; 0 starts one per core.

    Raises:
        InputError: If nothing can be written beside `out`, or `workers` is negative.
    """
    execution = Execution(workers=workers)
    parent = open_run_folder(out.parent).root
    for unfinished in parent.glob(f"{TEMPORARY_PREFIX}*"):  # of a killed process
        if unfinished.is_dir() and unfinished.name.startswith(f"{TEMPORARY_PREFIX}{out.name}."):
            shutil.rmtree(unfinished)
    root = parent / LEDGERS / out.name
    new = not root.exists()
    root.mkdir(parents=True, exist_ok=True)
    sweep(root)
    ledger = Ledger(root)
    ledger.save()
    try:
        with closing(make_executor(execution, root)) as executor:
            yield Context(ledger, executor)
    except VlnpeError:
        if new and not any(row.status == "done" for row in ledger.rows()):
            shutil.rmtree(root)
            with contextlib.suppress(OSError):  # not empty: ledgers of other outputs
                root.parent.rmdir()
        raise


def run_single(out: Path, stage: str, item: WorkItem) -> Row:
    """Open the ledger of `out` and run the one item that writes it; see `run_output`."""
    with open_single(out) as context:
        return run_output(context, out, stage, item)


def run_output(context: Context, out: Path, stage: str, item: WorkItem) -> Row:
    """Run one item that writes `out`, unless it did so before and nothing has changed since.

    Args:
        context: As opened by `open_single(out)`.
        out: File or folder that the item writes.
        stage: Name of the stage.
        item: What to do.

    Returns:
        The item's row; its facts are those of this run or of the earlier one.

    Raises:
        InputError: If the input is at fault.
        StageFailedError: If the item failed for another reason.
    """
    record = context.ledger.root / OUTPUT_NAME
    if not record.is_file() or record.read_text() != _state(item.key, out):
        context.ledger.forget(stage, [item.name])
    record.unlink(missing_ok=True)
    row = run_stage(context, stage, [item], required=True).good()[item.name]
    write_bytes(record, _state(item.key, out).encode())
    return row


def _state(key: str, out: Path) -> str:
    """Return what tells whether `out` is still what the item with this key wrote, as JSON."""
    paths = sorted(p for p in (out, *out.rglob("*")) if p.is_file())
    stats = [(str(p.relative_to(out)), p.stat().st_size, p.stat().st_mtime_ns) for p in paths]
    return json.dumps({"key": key, "files": stats})
