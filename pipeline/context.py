"""Open a ledger with worker processes: that of an output folder, or that of a single output."""

import contextlib
import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from ..formats.core.atomic import sweep_beside, write_bytes
from ..formats.core.errors import InputError, VlnpeError
from .engine.files import records_of
from .engine.ledger import JOURNAL_NAME, MANIFEST_NAME, QUARANTINE_NAME, Ledger, Row
from .engine.lock import LOCK_NAME, lock, sweep_unlocked
from .engine.run_folder import open_run_folder
from .engine.signals import ended_first
from .engine.work import WorkItem
from .execution.record import FOLDER as QUARANTINE_FOLDER
from .execution.runner import Context, run_stage
from .execution.settings import Execution, make_executor
from .options.command_line import command_line
from .options.running import Running
from .store.address import store_url
from .store.mirror import mirrored

LEDGERS = ".vlnpe"  # folder of the ledgers of single outputs, beside them
OUTPUT_NAME = "output.json"


@contextmanager
def open_context(root: Path, options: Running) -> Iterator[Context]:
    """Open an output folder with its ledger, lock it, and start what runs its items.

    Args:
        root: Output folder, created if it does not exist; or the URL of one in an object store,
            which is worked on in a scratch folder.
        options: The command's, which say how items are run.
    """
    execution = options.execution()
    if options.only and ":" not in options.only:
        raise InputError(f"--only {options.only}: valid: STAGE:ITEM, as quarantine.json lists them")
    with contextlib.ExitStack() as stack:
        if url := store_url(root):
            root, ledger_of = stack.enter_context(mirrored(url, wait=options.wait))
            sys.stderr.write(f"{url}: worked on in {root}\n")
        else:
            ledger_of = Ledger
        yield stack.enter_context(_opened(root, options, execution, ledger_of))


@contextmanager
def _opened(
    root: Path, options: Running, execution: Execution, ledger_of: Callable[[Path], Ledger]
) -> Iterator[Context]:
    """Open a local output folder; see `open_context`."""
    new = not root.exists()
    ours = any((root / name).is_file() for name in (MANIFEST_NAME, JOURNAL_NAME, LOCK_NAME))
    if root.is_dir() and any(root.iterdir()) and not ours:
        raise InputError(
            f"output folder {root}: not empty and not an earlier run; choose another --out"
        )
    folder = open_run_folder(root)
    with lock(folder.root, wait=options.wait):
        sweep_unlocked(folder.root)
        try:
            command = "" if type(options) is Running else command_line(options)
            whole = "" if options.only else command
            with _working(folder.root, execution, ledger_of, whole) as context:
                yield replace(
                    context,
                    explain=options.explain,
                    retry_quarantined=options.retry_quarantined,
                    only=options.only,
                    command=command,
                )
            if options.only:
                raise InputError(f"--only {options.only}: the command has no such item")
        except InputError as error:
            tracebacks = folder.root / QUARANTINE_FOLDER
            files = (p for p in folder.root.rglob("*") if p.is_file())
            left = {p.name for p in files if not p.is_relative_to(tracebacks)}
            if new and left <= {MANIFEST_NAME, QUARANTINE_NAME, LOCK_NAME}:
                shutil.rmtree(folder.root)
            elif not options.only:
                error.hints += resumption_hint(folder.root)
            raise
        except BaseException as error:
            sweep_unlocked(folder.root)  # of the workers that were ended
            if isinstance(error, VlnpeError):
                error.hints += resumption_hint(folder.root)
            raise


def resumption_hint(root: Path) -> tuple[str, ...]:
    """Return the line for a user whose run has failed: what its folder keeps; none if nothing."""
    done = Counter(row.stage for row in Ledger(root).done())
    if not done:
        return ()
    counts = ", ".join(f"{stage} {count}" for stage, count in done.items())
    return (
        f"{root} keeps what is finished ({counts}): the same command goes on from there, also "
        "with other options",
    )


@contextmanager
def open_single(out: Path, workers: int = 0) -> Iterator[Context]:
    """Open the ledger of one output, lock it, and start worker processes.

    For commands that run one stage and write the file or folder that the user names. The ledger
    lies beside it, in `.vlnpe/<name>/`, where a stage may also keep files to resume from.
    """
    execution = Execution(workers=workers)
    parent = open_run_folder(out.parent).root
    root = parent / LEDGERS / out.name
    new = not root.exists()
    root.mkdir(parents=True, exist_ok=True)
    with lock(root):
        sweep_beside([parent / out.name])
        sweep_unlocked(root)
        try:
            with _working(root, execution) as context:
                yield context
        except VlnpeError:
            if new and not Ledger(root).done():
                shutil.rmtree(root)
                with contextlib.suppress(OSError):  # not empty: ledgers of other outputs
                    root.parent.rmdir()
            raise
        except BaseException:
            sweep_beside([parent / out.name])
            raise


@contextmanager
def _working(
    root: Path,
    execution: Execution,
    ledger_of: Callable[[Path], Ledger] = Ledger,
    command: str = "",
) -> Iterator[Context]:
    """Start what runs items; once some run, the ledger says that `command` has not ended."""
    ledger = ledger_of(root)
    ledger.command = command
    ledger.save()
    with make_executor(execution, root) as executor, ended_first(executor.kill_processes):
        yield Context(ledger, executor)
    # A run that found all done leaves the manifest as it is.
    ended = bool(command and (ledger.unfinished or not ledger.finished))
    if ended:
        ledger.unfinished, ledger.finished = "", command
    if ended or (root / JOURNAL_NAME).is_file():
        ledger.save()
    ledger.finish()


def run_single(out: Path, stage: str, item: WorkItem) -> Row:
    """Open the ledger of `out` and run the one item that writes it; see `run_output`."""
    with open_single(out) as context:
        return run_output(context, out, stage, item)


def run_output(context: Context, out: Path, stage: str, item: WorkItem) -> Row:
    """Run one item that writes `out`, unless it did so before and nothing has changed since.

    Args:
        context: As opened by `open_single(out)`.

    Returns:
        The item's row; its facts are those of this run or of the earlier one.

    Raises:
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
    """Return a record of whether `out` is still what the item with this key wrote, as JSON.

    Content counts, not times: some file systems keep times of two seconds, and clocks jump.
    """
    return json.dumps({"key": key, "files": records_of(out)}, sort_keys=True)
