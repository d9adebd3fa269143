"""Undo the real-time scheduling that an encoder gives to threads.

SVT-AV1 tries on the calling thread whether it may have real-time priority, and leaves it there:
run by root, as in containers, that thread and every process it starts afterwards push all others
aside, and a lock that spins for one of these may never come free.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

_TASKS = Path("/proc/self/task")


@contextlib.contextmanager
def ordinary_threads() -> Iterator[Callable[[], None]]:
    """Give threads that become real-time inside the block ordinary scheduling after it.

    Yields:
        A function that does the same at once, for blocks that go on after the encoder has started.
        Where the process was real-time before, or threads cannot be listed, nothing is changed.
    """
    as_it_was = not _TASKS.is_dir() or _is_real_time(0)
    restore = (lambda: None) if as_it_was else _make_ordinary
    try:
        yield restore
    finally:
        restore()


def _is_real_time(thread: int) -> bool:
    return os.sched_getscheduler(thread) in (os.SCHED_FIFO, os.SCHED_RR)


def _make_ordinary() -> None:
    for task in _TASKS.iterdir():
        with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
            if _is_real_time(int(task.name)):
                os.sched_setscheduler(int(task.name), os.SCHED_OTHER, os.sched_param(0))
