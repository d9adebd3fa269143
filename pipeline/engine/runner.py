"""Run a stage's items: skip what is done, run the rest in parallel, quarantine what fails."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ...formats.core.errors import InputError, VlnpeError
from ...formats.core.progress import progress_bar
from .attempts import Outcome, run_items
from .executors import Executor
from .files import Records
from .ledger import Ledger, Row
from .work import WorkItem

log = logging.getLogger(__name__)

BAR_LABEL = 22  # characters of a bar's name: stage, robot and controller

# The output folder itself is unusable: going on would fail every item for the same reason.
FATAL_ERRNO = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM}


@dataclass
class StageSummary:
    """Counts of one stage's run; `rows` are all its items' rows, reused ones too.

    `done` counts what this run did, `reused` what it found done; `failed` those of both with a bad
    outcome.
    """

    stage: str
    done: int = 0
    reused: int = 0
    failed: int = 0
    quarantined: int = 0
    seconds: float = 0.0
    rows: list[Row] = field(default_factory=list)

    def counts(self) -> dict[str, int | float]:
        """Return plain numbers for tables and `--json`."""
        return {
            "done": self.done,
            "reused": self.reused,
            "failed": self.failed,
            "quarantined": self.quarantined,
            "seconds": round(self.seconds, 2),
        }

    def joined(self, other: StageSummary) -> StageSummary:
        """Return both runs of one stage (for two robots, …) as one."""
        return StageSummary(
            self.stage,
            self.done + other.done,
            self.reused + other.reused,
            self.failed + other.failed,
            self.quarantined + other.quarantined,
            self.seconds + other.seconds,
            [*self.rows, *other.rows],
        )

    def good(self) -> dict[str, Row]:
        """Return the rows of items that are done, by item name."""
        return {r.item: r for r in self.rows if r.status == "done"}


@dataclass(frozen=True)
class Context:
    """Where a stage records its work and what it may use.

    Attributes:
        ledger: of the run folder (or of a single stage's output folder).
        workers: run the items of all stages.
        progress: show progress bars.
    """

    ledger: Ledger
    workers: Executor
    progress: bool = True


def run_stage(
    context: Context,
    stage: str,
    items: Sequence[WorkItem],
    scope: str = "",
    required: bool = False,
) -> StageSummary:
    """Run the items that are not done yet.

    Args:
        context: ledger and workers.
        stage: its name in the ledger.
        items: all that should exist when the stage has ended.
        scope: earlier rows whose item starts with it and is not among `items` are no longer
            current (the same stage may run once per robot; each run is its own scope).
        required: without a single good item there is nothing left to do, and the run ends.

    Raises:
        InputError: a file cannot be written, or all items of a required stage failed for a reason
            that lies in the user's input.
        StageFailedError: all items of a required stage failed for another reason.
    """
    started = time.perf_counter()
    summary = StageSummary(stage)
    ledger = context.ledger
    ledger.select(stage, scope, {item.name for item in items})
    waiting: list[WorkItem] = []
    for item in items:
        if ledger.is_done(stage, item.name, item.key):
            row = ledger.row(stage, item.name)
            assert row is not None
            summary.reused += 1
            summary.failed += row.failed
            summary.rows.append(row)
        else:
            waiting.append(item)
    ledger.forget(stage, [item.name for item in waiting])
    bar = progress_bar(
        f"{' '.join([stage, *scope.split('/')[:2]]):<{BAR_LABEL}}",
        len(items),
        initial=len(items) - len(waiting),
        note=_note(summary),
        show=context.progress,
    )
    errors: list[BaseException] = []
    try:
        for item, outcome in run_items(context.workers, waiting):
            row = _row(stage, item, outcome, ledger.root)
            ledger.add(row, _files(outcome, ledger.root))
            summary.rows.append(row)
            summary.done += row.status == "done"
            summary.failed += row.failed
            if outcome.error is not None:
                summary.quarantined += 1
                errors.append(outcome.error)
            bar.set_postfix_str(_note(summary), refresh=False)
            bar.update()
    except BaseException:
        with contextlib.suppress(OSError):  # a full disk must not hide that it is full
            ledger.save()
        raise
    finally:
        bar.close()
    ledger.save()
    summary.rows.sort(key=lambda r: r.item)
    summary.seconds = time.perf_counter() - started
    if required and errors and len(errors) == len(items):
        first = errors[0]
        message = str(first) if len(errors) == 1 else f"all {len(errors)} items failed: {first}"
        if all(isinstance(e, InputError) for e in errors):
            raise InputError(message) from first
        raise StageFailedError(f"{stage}: {message or repr(first)}") from first
    for row in summary.rows:
        if row.status == "quarantined":
            log.warning("%s %s quarantined: %s", stage, row.item, row.error["reason"])
    return summary


class StageFailedError(VlnpeError):
    """Every item of a required stage failed, and the input is not the reason."""


def _note(summary: StageSummary) -> str:
    return (
        f"done {summary.done}, reused {summary.reused}, failed {summary.failed}"
        f", quarantined {summary.quarantined}"
    )


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
            facts=outcome.result.facts,
        )
    if isinstance(error, OSError) and error.errno in FATAL_ERRNO:
        raise InputError(f"cannot use {error.filename or root}: {error.strerror}")
    log.debug("%s %s", item.name, outcome.traceback)
    reason = str(error) if isinstance(error, VlnpeError) else repr(error)
    described = {"type": type(error).__name__, "reason": reason}
    return Row(stage, item.name, item.key, "quarantined", error=described)


def _files(outcome: Outcome, root: Path) -> dict[str, Records]:
    return {os.path.relpath(path, root): records for path, records in outcome.files.items()}
