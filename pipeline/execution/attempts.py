"""Run items in worker processes, and find the one that kills its worker."""

import pickle
import sys
import time
import traceback
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Future, as_completed
from dataclasses import dataclass, field
from pathlib import Path

from ...formats import process
from ...formats.core.atomic import sweep_beside
from ...formats.core.errors import VlnpeError
from ...formats.process.threads import allow_threads
from ..engine.files import Records, all_records
from ..engine.work import ItemResult, Job, WorkItem
from .base import Executor

# Failures that the same item need not have again, by name: memory, servers, budgets.
TRANSIENT = frozenset(
    {"WorkerDiedError", "ModelError", "ModelDownError", "BudgetError", "PolicyError"}
)

KERNELS = f"{process.__name__}.kernel"

MACHINES_LOST = 5  # in a row; an item that kills a machine each time must not go on for ever


class WorkerDiedError(VlnpeError):
    """A worker process died while it worked on an item alone."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one item.

    Attributes:
        seconds: Wall time that it took [s].
        cpu_seconds: CPU time that it took, of all threads [s].
        compile_seconds: Wall time in which it compiled kernels [s].
        files: Records of the files of its outputs, by output.
    """

    result: ItemResult = field(default_factory=ItemResult)
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    compile_seconds: float = 0.0
    files: dict[Path, Records] = field(default_factory=dict)
    error: BaseException | None = None
    traceback: str = ""


def run_items(workers: Executor, items: Sequence[WorkItem]) -> Iterable[tuple[WorkItem, Outcome]]:
    """Yield outcomes as they come.

    A dying worker breaks the whole pool, and it is unknown which item killed it. So all items that
    were lost are tried together once more; those lost again are tried alone, which finds the one.
    """
    lost = yield from _attempt_on(workers, items)
    lost = yield from _attempt_on(workers, lost)
    for item in lost:
        if (yield from _attempt_on(workers, [item])):
            error = WorkerDiedError("its worker process died (out of memory?)")
            yield item, Outcome(error=error, traceback=f"{error}\n")


def _attempt_on(
    workers: Executor, items: Sequence[WorkItem]
) -> Generator[tuple[WorkItem, Outcome], None, list[WorkItem]]:
    """Run items as `_attempt`; a loss together with a machine does not count as an attempt."""
    for _ in range(MACHINES_LOST if items else 0):
        items = yield from _attempt(workers, items)
        if not items or not _restart(workers, items):
            break
    return list(items)


def _restart(workers: Executor, lost: Iterable[WorkItem]) -> bool:
    """Replace the pool, and remove what the dead left half-written; return as `restart` does."""
    machine_lost = workers.restart()
    sweep_beside(path for item in lost for path in item.outputs)
    return machine_lost


def _attempt(
    workers: Executor, items: Sequence[WorkItem]
) -> Generator[tuple[WorkItem, Outcome], None, list[WorkItem]]:
    """Run items in the pool; return those that were lost because the pool broke."""
    lost: list[WorkItem] = []
    futures: dict[Future[Outcome], WorkItem] = {}
    # A lone item (a big scene) may use all the cores that its idle neighbours leave.
    threads = max(1, workers.cores // max(1, len(items)))
    for item in items:
        try:
            futures[workers.submit(attempt, item.job, item.outputs, threads)] = item
        except BrokenExecutor:
            lost.append(item)
    workers.flush()
    for future in as_completed(futures):
        try:
            yield futures[future], future.result()
        except BrokenExecutor:
            lost.append(futures[future])
        except Exception as error:  # its arguments or its result cannot be pickled
            yield futures[future], Outcome(error=error, traceback=traceback.format_exc())
    return lost


@dataclass(frozen=True)
class Link:
    """An item of a chain: items of several stages that one worker runs one after the other.

    Attributes:
        needed: Whether the links after it read what it writes.
        wants_success: Whether it is left out after an item with a bad outcome.
    """

    stage: str
    item: WorkItem
    needed: bool = False
    wants_success: bool = False


Chain = Sequence[Link]


def run_chains(
    workers: Executor, chains: Sequence[Chain]
) -> Iterator[list[tuple[Link, Outcome | None]]]:
    """Yield the outcomes of each chain, None for links that were left out.

    Chains that were lost because a worker died are left out: which item did it is found out by
    `run_items`.
    """
    threads = max(1, workers.cores // max(1, len(chains)))
    futures: dict[Future[list[Outcome | None]], Chain] = {}
    for chain in chains:
        steps = [(k.item.job, k.item.outputs, k.needed, k.wants_success) for k in chain]
        try:
            futures[workers.submit(attempt_chain, steps, threads)] = chain
        except BrokenExecutor:
            break
    lost = len(futures) < len(chains)
    for future in as_completed(futures):
        try:
            outcomes = future.result()
        except Exception:  # that of a dead worker, or of arguments that cannot be pickled
            lost = True
            continue
        yield list(zip(futures[future], outcomes, strict=True))
    if lost:
        _restart(workers, (link.item for chain in chains for link in chain))


def attempt_chain(
    steps: Sequence[tuple[Job, Sequence[Path], bool, bool]], threads: int
) -> list[Outcome | None]:
    """Run jobs one after the other in this process; see `attempt` and `Link`.

    Args:
        steps: Job, outputs, `needed` and `wants_success` of each.

    Returns:
        The outcome of each; None where it was left out.
    """
    outcomes: list[Outcome | None] = []
    broken = unsuccessful = False
    for job, outputs, needed, wants_success in steps:
        if broken or (wants_success and unsuccessful):
            outcomes.append(None)
            continue
        outcome = attempt(job, outputs, threads)
        outcomes.append(outcome)
        broken |= needed and outcome.error is not None
        unsuccessful |= outcome.result.failed
    return outcomes


def keep_mujoco_from_writing() -> None:
    """Let MuJoCo, if this process has loaded it, warn on stderr alone.

    By default it also writes MUJOCO_LOG.TXT into the folder that the user is in.
    """
    if mujoco := sys.modules.get("mujoco"):
        config = mujoco.MjLogConfig.get()
        config.logto_file = False
        config.set()


def _compile_seconds() -> float:
    kernel = sys.modules.get(KERNELS)  # takes long to import, and not every job uses it
    return kernel.compile_seconds() if kernel else 0.0


def attempt(job: Job, outputs: Sequence[Path], threads: int) -> Outcome:
    """Run a job in this process, and record the files that it wrote."""
    started, cpu_started = time.perf_counter(), time.process_time()
    compiled_before = _compile_seconds()
    keep_mujoco_from_writing()
    try:
        with allow_threads(threads):
            result = job.run()
        seconds = time.perf_counter() - started
        cpu_seconds = time.process_time() - cpu_started
        # Now, while the files are still in the page cache.
        compiled = _compile_seconds() - compiled_before
        return Outcome(result, seconds, cpu_seconds, compiled, all_records(outputs))
    except Exception as error:
        text = traceback.format_exc()
        return Outcome(error=_portable(error), traceback=text)


def _portable(error: Exception) -> Exception:
    """Return an error that can be pickled; any other would break the worker pool."""
    error.__traceback__ = None
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return VlnpeError(f"{type(error).__name__}: {error}")
    return error
