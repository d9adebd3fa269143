"""Worker processes of this machine."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from typing import Any

from ...formats.process.memory import collect_cycles_less_often
from ...formats.process.source import write_cache
from ..engine.signals import without_interrupts
from .base import Executor


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
            write_cache()  # or every worker parses the source again
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
        # The pool has `kill_workers` from Python 3.14 on.
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
    collect_cycles_less_often()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: Any) -> None:
    parent.join()
    os.killpg(0, signal.SIGKILL)
