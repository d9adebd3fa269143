"""Worker processes for one machine."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any


def available_cores() -> int:
    """Return the number of cores this process may use (respects the affinity mask)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers:
    """A pool of worker processes, started when first used and shared by all stages.

    Workers are spawned, never forked: Embree, numba and PyAV hold threads that a fork would break.
    Each leads a process group of its own, so that Ctrl-C reaches this process alone, and ends
    with its children when this process has died.
    """

    def __init__(self, count: int):
        """Set the number of processes, at least 1; none is started yet."""
        self.count = count
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` in a worker."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                self.count, mp_context=context, initializer=_lead_and_watch
            )
        with _without_interrupts():
            return self._pool.submit(function, *arguments)

    def restart(self) -> None:
        """Replace a pool whose worker died."""
        self.close()

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

    def __enter__(self) -> Workers:
        """Use as a context manager: the workers end with the block."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        """End the workers; do not wait for their items if the block ended with an error."""
        if kind is None:
            self.close()
        else:
            self.kill()


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Hold back SIGINT in this thread; processes started meanwhile never receive it.

    Otherwise Ctrl-C would print the traceback of a worker that is still importing.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _lead_and_watch() -> None:
    """Lead a process group, and end it when the parent process has died, even by SIGKILL."""
    os.setpgrp()
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()


def _end_after(parent: Any) -> None:
    parent.join()
    os.killpg(0, signal.SIGKILL)
