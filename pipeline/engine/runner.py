"""Run a stage's items: skip what is done, run the rest in parallel, quarantine what fails."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import pickle
import time
import traceback
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Future, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path

from ...formats.core.errors import InputError, VlnpeError
from ...formats.core.progress import progress_bar
from .executors import Workers
from .ledger import Ledger, Row
from .work import ItemResult, Job, WorkItem

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
        workers: process pool shared by all stages.
        progress: show progress bars.
    """

    ledger: Ledger
    workers: Workers
    progress: bool = True


def run_stage(
    context: Context,
    stage: str,
    items: Sequence[WorkItem],
    scope: str = "",
    required: bool = False,
    *,
    label: str = "",
) -> StageSummary:
    """Run the items that are not done yet.

    Args:
        context: ledger and workers.
        stage: its name in the ledger.
        items: all that should exist when the stage has ended.
        scope: earlier rows whose item starts with it and is not among `items` are no longer
            current (the same stage may run once per robot; each run is its own scope).
        required: without a single good item there is nothing left to do, and the run ends.
        label: name on the progress bar; that of the stage by default.

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
        f"{' '.join([label or stage, *scope.split('/')[:2]]):<{BAR_LABEL}}",
        len(items),
        initial=len(items) - len(waiting),
        note=_note(summary),
        show=context.progress,
    )
    errors: list[BaseException] = []
    try:
        for item, outcome, seconds in _outcomes(context.workers, waiting):
            row = _row(stage, item, outcome, seconds, ledger.root)
            ledger.add(row)
            summary.rows.append(row)
            summary.done += row.status == "done"
            summary.failed += row.failed
            if isinstance(outcome, BaseException):
                summary.quarantined += 1
                errors.append(outcome)
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


def _row(
    stage: str, item: WorkItem, outcome: ItemResult | BaseException, seconds: float, root: Path
) -> Row:
    if isinstance(outcome, ItemResult):
        return Row(
            stage,
            item.name,
            item.key,
            "done",
            failed=outcome.failed,
            outputs=tuple(os.path.relpath(p, root) for p in item.outputs),
            seconds=seconds,
            facts=outcome.facts,
        )
    if isinstance(outcome, OSError) and outcome.errno in FATAL_ERRNO:
        raise InputError(f"cannot use {outcome.filename or root}: {outcome.strerror}")
    log.debug("%s %s", item.name, "".join(traceback.format_exception(outcome)))
    reason = str(outcome) if isinstance(outcome, VlnpeError) else repr(outcome)
    error = {"type": type(outcome).__name__, "reason": reason}
    return Row(stage, item.name, item.key, "quarantined", seconds=seconds, error=error)


def _outcomes(
    workers: Workers, items: Sequence[WorkItem]
) -> Iterable[tuple[WorkItem, ItemResult | BaseException, float]]:
    """Results as they come.

    A dying worker breaks the whole pool, and it is unknown which item killed it. So all items that
    were lost are tried together once more; those lost again are tried alone, which finds the one.
    """
    orphans = yield from _attempt(workers, items)
    if orphans:
        workers.restart()
        orphans = yield from _attempt(workers, orphans)
    for item in orphans:
        workers.restart()
        if (yield from _attempt(workers, [item])):
            workers.restart()
            yield item, VlnpeError("its worker process died (out of memory?)"), 0.0


def _attempt(
    workers: Workers, items: Sequence[WorkItem]
) -> Generator[tuple[WorkItem, ItemResult | BaseException, float], None, list[WorkItem]]:
    """Run items in the pool; return those that were lost because the pool broke."""
    lost: list[WorkItem] = []
    futures: dict[Future[tuple[ItemResult, float]], WorkItem] = {}
    # A lone item (a big scene) may use all the cores that its idle neighbours leave.
    threads = max(1, workers.count // max(1, len(items)))
    for item in items:
        try:
            futures[workers.submit(_timed, item.job, threads)] = item
        except BrokenProcessPool:
            lost.append(item)
    for future in as_completed(futures):
        item = futures[future]
        try:
            result, seconds = future.result()
        except BrokenProcessPool:
            lost.append(item)
        except Exception as error:
            yield item, error, 0.0
        else:
            yield item, result, seconds
    return lost


def _timed(job: Job, threads: int) -> tuple[ItemResult, float]:
    import numba

    most = numba.config.NUMBA_NUM_THREADS  # pyright: ignore
    numba.set_num_threads(min(threads, most))
    started = time.perf_counter()
    try:
        result = job.run()
    except Exception as error:
        raise _portable(error) from None
    return result, time.perf_counter() - started


def _portable(error: Exception) -> Exception:
    """Return an error that can be pickled; any other would break the worker pool."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return VlnpeError(f"{type(error).__name__}: {error}")
    return error
