"""Worker processes for one machine."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from typing import Any


def available_cores() -> int:
    """Return the number of cores this process may use (respects the affinity mask)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers:
    """A pool of worker processes, started when first used and shared by all stages.

    Workers are spawned, never forked: Embree, numba and PyAV hold threads that a fork would break.
    """

    def __init__(self, count: int):
        """Set the number of processes, at least 1; none is started yet."""
        self.count = count
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run `function(*arguments)` in a worker."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self.count, mp_context=context)
        return self._pool.submit(function, *arguments)

    def restart(self) -> None:
        """Replace a pool whose worker died."""
        self.close()

    def close(self) -> None:
        """End the workers; waiting items are dropped."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def __enter__(self) -> Workers:
        """Use as a context manager: the workers end with the block."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the workers."""
        self.close()
