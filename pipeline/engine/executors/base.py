"""Where the items of a stage run: worker processes of this machine, or of a cluster."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from ....formats.core.errors import InputError, check_name
from ....formats.core.threads import available_cores
from ..signals import without_interrupts

LOCAL, RAY, SLURM = "local", "ray", "slurm"
EXECUTORS = (LOCAL, RAY, SLURM)


@dataclass(frozen=True)
class Execution:
    """Where a run's items are executed.

    Attributes:
        executor: `local`, `ray` or `slurm`.
        workers: how many items run at a time; 0 takes one per core, or what the cluster has.
        ray_address: of a running Ray cluster; empty takes `RAY_ADDRESS`, or starts one here.
        slurm: options of the batch jobs, `name=value` with commas.
        dry_run: write the batch scripts of the first stage that has work and end.
    """

    executor: str = LOCAL
    workers: int = 0
    ray_address: str = ""
    slurm: str = ""
    dry_run: bool = False

    def __post_init__(self) -> None:
        check_name("executor", self.executor, EXECUTORS)
        if self.workers < 0:
            raise InputError(f"--workers {self.workers}: valid: 0 (one per core) and above")
        if self.dry_run and self.executor != SLURM:
            raise InputError(f"--dry-run with --executor {self.executor}; valid: with {SLURM}")


class Executor:
    """Interface of what runs items for the stage runner; a context manager that closes itself.

    Attributes:
        count: how many items run at a time.
        cores: how many cores a lone item may use.
        chains: whether items of several stages may run as one; not where a lost machine should cost
            as little as possible, or where each stage is submitted by itself.
    """

    count: int
    cores: int
    chains: bool = False

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` in a worker, at the latest after `flush`.

        The future raises BrokenExecutor if the worker died.
        """
        raise NotImplementedError

    def expect(self, items: int, modules: Sequence[str]) -> None:
        """Say how many items will need some modules; idle workers may import them beforehand."""

    def flush(self) -> None:
        """Start what has been submitted; where items start at once, there is nothing to do."""

    def restart(self) -> bool:
        """Make the executor usable again after a worker died.

        Return whether a whole machine was lost, which is no fault of the items that ran on it.
        """
        return False

    def close(self) -> None:
        """End the workers; waiting items are dropped."""
        raise NotImplementedError

    def kill_processes(self) -> None:
        """End at once what runs; called when this process is about to be ended."""
        self.close()

    def __enter__(self) -> Self:
        """Use as a context manager: the workers end with the block."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        """Close."""
        self.close()


def make_executor(execution: Execution, root: Path) -> Executor:
    """Return the executor that `execution` asks for.

    Args:
        root: run folder, shared by all machines of a cluster.

    Raises:
        InputError: its extra is not installed, or the cluster cannot be reached.
    """
    if execution.executor == RAY:
        from .ray import RayExecutor

        return RayExecutor(execution.ray_address, execution.workers)
    if execution.executor == SLURM:
        from .slurm import SlurmExecutor

        return SlurmExecutor(root, execution.slurm, execution.workers, execution.dry_run)
    return Workers(execution.workers or available_cores())


class Workers(Executor):
    """A pool of worker processes, started when first used and shared by all stages.

    Workers are spawned, never forked: Embree, numba and PyAV hold threads that a fork would break.
    Each leads a process group of its own, so that Ctrl-C reaches this process alone, and ends
    with its children when this process has died.
    """

    chains = True

    def __init__(self, count: int):
        """Set the number of processes, at least 1; none is started yet."""
        self.count = self.cores = count
        self._pool: ProcessPoolExecutor | None = None
        self._expected: list[tuple[str, ...]] = []

    def expect(self, items: int, modules: Sequence[str]) -> None:
        """Let further workers, no more than items, start and import while the first item runs."""
        self._expected = [tuple(modules)] * (min(self.count, items) - 1)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` in a worker."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                self.count, mp_context=context, initializer=_lead_and_watch
            )
        with without_interrupts():
            future = self._pool.submit(function, *arguments)
            while self._expected:
                modules = self._expected.pop()
                with contextlib.suppress(BrokenExecutor):  # the item's own future tells
                    self._pool.submit(_import, modules)
        return future

    def restart(self) -> bool:
        """Replace a pool whose worker died."""
        self.close()
        return False

    def close(self) -> None:
        """End the workers; waiting items are dropped."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def kill(self) -> None:
        """End the workers at once, whatever they are doing."""
        self.kill_processes()
        self.close()

    def kill_processes(self) -> None:
        """Kill the workers and their children; the pool is broken afterwards."""
        # Of the standard library's pool until Python 3.14, which has `kill_workers`.
        processes = self._pool._processes if self._pool is not None else None
        for process in list((processes or {}).values()):
            if process.pid is not None:
                # A worker that has only just started leads no group yet.
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.kill()

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        """End the workers; do not wait for their items if the block ended with an error."""
        if kind is None:
            self.close()
        else:
            self.kill()


def _import(modules: Sequence[str]) -> None:
    for name in modules:
        importlib.import_module(name)


def _lead_and_watch() -> None:
    """Lead a process group, and end it when the parent process has died, even by SIGKILL."""
    os.setpgrp()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: Any) -> None:
    parent.join()
    os.killpg(0, signal.SIGKILL)
