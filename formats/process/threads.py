"""Threads within an item of work: as many as the item may use, and the same result with any number.

A lone item (a big scene) may use the cores that idle workers leave. It runs what does not depend on
each other at the same time; compiled code, images and rays let other threads run meanwhile.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar

# Threads that are started here see the default: what runs in them starts no others.
_ALLOWED: ContextVar[int] = ContextVar("threads", default=1)


def available_cores() -> int:
    """Return the number of cores this process may use (respects the affinity mask)."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def allow_threads(count: int) -> Iterator[None]:
    """Let the code inside the block work with up to `count` threads, its own included."""
    token = _ALLOWED.set(count)
    try:
        yield
    finally:
        _ALLOWED.reset(token)


@contextmanager
def beside[R](function: Callable[[], R]) -> Iterator[Callable[[], R]]:
    """Run a function in another thread, if one is allowed, while the block does other work.

    Yields:
        A function to call once, which returns the result, or raises the error. With a single thread
        the work is done in that call.
    """
    if _ALLOWED.get() < 2:
        yield function
        return
    # Leaving the block waits: an error in it must not leave a thread that still writes files.
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(function).result


def in_order[I, R](
    function: Callable[[I], R], items: Iterable[I], busy: bool = False
) -> Generator[R, None, None]:
    """Yield the results of a function for `items`, in their order, from the allowed threads.

    Args:
        items: its arguments, drawn a few ahead, in the caller's thread.
        busy: the caller works on the results meanwhile, so that one thread is left to it.
    """
    count = _ALLOWED.get() - busy
    if _ALLOWED.get() < 2:
        yield from map(function, items)
        return
    waiting: deque[Future[R]] = deque()
    with ThreadPoolExecutor(count) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def made_ahead[T](
    items: Iterator[T], waited: Callable[[float], None] = lambda seconds: None
) -> Generator[T, None, None]:
    """Yield items, each made in a thread while the caller works on the one before.

    That thread is not one of the allowed ones: it is meant for reading, not for computing.

    Args:
        items: drawn in that thread alone; nothing in it may depend on what the caller does.
        waited: called with the seconds for which the caller waited, once per item.
    """
    end = object()
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(next, items, end)
        while True:
            start = time.perf_counter()
            item = coming.result()
            if item is end:
                return
            waited(time.perf_counter() - start)
            coming = pool.submit(next, items, end)
            yield item  # type: ignore[misc]
