"""Run a stage's items: skip what is done, run the rest in parallel, quarantine what fails."""

import contextlib
import logging
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from ...formats.core.atomic import sweep_beside
from ...formats.core.errors import InputError, VlnpeError
from ...formats.process.progress import progress_bar
from ..engine.explain import changes, parts_of
from ..engine.ledger import Ledger
from ..engine.rows import Row, StageSummary
from ..engine.signals import OnlyDone
from ..engine.work import WorkItem
from .attempts import attempt, run_items
from .base import Executor
from .parts import watched
from .record import forget_failure, record

log = logging.getLogger(__name__)

BAR_LABEL = 22  # characters of a bar's name: stage, robot and controller


@dataclass(frozen=True)
class Context:
    """The ledger and the workers of a stage, and how it treats items.

    Attributes:
        ledger: of the run folder (or of a single stage's output folder).
        workers: run the items of all stages.
        explain: report for every item why it runs or is reused.
        retry_quarantined: run items again that failed before, and would fail again.
        only: `STAGE:ITEM`, the one item to run; empty runs all.
        command: the command line that runs one item alone, up to its name; empty if there is none.
        ahead: what this run did ahead of the stages, by stage and item: its share of the wall time
            [s]; see `ahead`.
    """

    ledger: Ledger
    workers: Executor
    progress: bool = True
    explain: bool = False
    retry_quarantined: bool = False
    only: str = ""
    command: str = ""
    ahead: dict[tuple[str, str], float] = field(default_factory=dict)


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

    An item that was quarantined under the same key would fail again, and stays quarantined unless
    the context says otherwise, it failed for want of memory, disk or network, or it is required.

    Args:
        stage: its name in the ledger.
        items: all that should exist when the stage has ended.
        scope: earlier rows whose item starts with it and is not among `items` are no longer
            current (the same stage may run once per robot; each run is its own scope).
        required: without a single good item there is nothing left to do, and the run ends.
        label: name on the progress bar; that of the stage by default.

    Raises:
        StageFailedError: all items of a required stage failed for another reason.
        OnlyDone: the context asks for one item alone, and it has run.
    """
    check_distinct(stage, items)
    started = time.perf_counter()
    summary = StageSummary(stage)
    ledger = context.ledger
    if not context.only:
        ledger.select(stage, scope, {item.name for item in items})
    waiting: list[WorkItem] = []
    for item in items:
        row = ledger.row(stage, item.name)
        ahead_s = context.ahead.get((stage, item.name))
        if row is not None and row.key == item.key and ahead_s is not None:
            summary.count(row)
            summary.seconds += ahead_s
            continue
        reason = why(context, stage, item, row, required)
        if context.explain:
            verdict = f"runs: {reason}" if reason else f"is reused ({_state(row)})"
            sys.stderr.write(f"{stage} {item.name} {verdict}\n")
        if reason or row is None:
            waiting.append(item)
            continue
        summary.reused += row.status == "done"
        summary.quarantined += row.status == "quarantined"
        summary.failed += row.failed
        summary.rows.append(row)
    if context.only:
        _run_only(context, stage, items, waiting)
        return summary
    if waiting:
        ledger.begin()
    for item in waiting:
        forget_failure(ledger, stage, item)
    ledger.forget(stage, [item.name for item in waiting])
    bar = progress_bar(
        f"{' '.join([label or stage, *scope.split('/')[:2]]):<{BAR_LABEL}}",
        len(items),
        initial=len(items) - len(waiting),
        note=_note(summary),
        # Items that were done ahead had a bar of their own.
        show=context.progress and (bool(waiting) or summary.done == 0),
    )
    errors: list[BaseException] = []
    try:
        with watched(bar, waiting) as watch:
            for item, outcome in run_items(context.workers, waiting):
                summary.count(record(ledger, stage, item, outcome, context.command))
                if outcome.error is not None:
                    errors.append(outcome.error)
                watch.count(item, _note(summary))
    except BaseException:
        drop(context, waiting)
        raise
    finally:
        bar.close()
    ledger.save()
    summary.rows.sort(key=lambda r: r.item)
    summary.seconds += time.perf_counter() - started
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


def drop(context: Context, items: Iterable[WorkItem]) -> None:
    """End the workers, remove what they left half-written, and keep what is known to be done."""
    context.workers.kill_processes()
    sweep_beside(path for item in items for path in item.outputs)
    with contextlib.suppress(OSError):  # a full disk must not hide that it is full
        context.ledger.save()


def check_distinct(stage: str, items: Sequence[WorkItem]) -> None:
    """Raise unless all items have names of their own, on any file system.

    Two items of one name would share a row and their files, and one would be lost without a word.
    """
    by_name: dict[str, str] = {}
    for item in items:
        name = item.name.casefold()
        if name in by_name:
            raise VlnpeError(f"{stage}: {item.name} and {by_name[name]} share one file name")
        by_name[name] = item.name


def why(
    context: Context, stage: str, item: WorkItem, row: Row | None, required: bool = False
) -> str:
    """Return why an item runs; empty if its row is still good."""
    ledger = context.ledger
    if row is None:
        return "it has not been finished in this folder"
    if row.key != item.key:
        if not context.explain:
            return "its key has changed"
        names = {other.key[:16]: f"{other.stage} {other.item}" for other in ledger.rows()}
        now = parts_of(item.inputs, item.job)
        lines = changes(row.parts, ledger.values(), now, names) if row.parts else []
        return "; ".join(lines) or "an earlier version made it"
    if row.status == "quarantined":
        if context.retry_quarantined or required or row.error.get("transient"):
            return f"it was quarantined: {row.error.get('reason', '')}"
        return ""
    return ledger.lost(row)


def _state(row: Row | None) -> str:
    quarantined = row is not None and row.status == "quarantined"
    return "still quarantined; --retry-quarantined runs it" if quarantined else "unchanged"


def _run_only(
    context: Context, stage: str, items: Sequence[WorkItem], waiting: Sequence[WorkItem]
) -> None:
    """Run the one item that was asked for, in this process, if it is one of this stage."""
    target_stage, _, target = context.only.partition(":")
    if stage != target_stage:
        if waiting:
            raise InputError(
                f"--only {context.only}: {stage} {waiting[0].name} must be finished first; run the "
                "command without --only first"
            )
        return
    matches = [item for item in items if item.name == target]
    if not matches:
        return  # of another robot, or unknown: the command says so at its end
    forget_failure(context.ledger, stage, matches[0])
    context.ledger.forget(stage, [target])
    outcome = attempt(matches[0].job, matches[0].outputs, os.cpu_count() or 1)
    row = record(context.ledger, stage, matches[0], outcome, context.command)
    context.ledger.save()
    sys.stderr.write(outcome.traceback or f"{stage} {target}: done\n")
    raise OnlyDone(row.status == "done")


def _note(summary: StageSummary) -> str:
    counts = {"quarantined": summary.quarantined, "failed": summary.failed}
    counts |= {"reused": summary.reused, "seconds of compiling": round(summary.compile_seconds)}
    return counted(counts)


def counted(counts: Mapping[str, int]) -> str:
    """Return what there is of some kinds, for a bar, e.g. `failed 1, reused 12`."""
    return ", ".join(f"{kind} {count}" for kind, count in counts.items() if count)
