"""Standard output and error that nobody may be reading."""

import os
import select
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

_AT_ONCE = 4096  # bytes that a pipe takes whole once it takes any


@contextmanager
def never_waiting() -> Iterator[None]:
    """Drop what a full pipe does not take, of all that is written in this block.

    A robot in real time must not stand still because nobody reads what its process prints.
    """
    with ExitStack() as stack:
        for stream in (sys.stdout, sys.stderr):
            if stat.S_ISFIFO(os.fstat(stream.fileno()).st_mode):
                stack.enter_context(_forwarded(stream.fileno()))
                stack.callback(stream.flush)
        yield


@contextmanager
def _forwarded(descriptor: int) -> Iterator[None]:
    out = os.dup(descriptor)
    read, write = os.pipe()
    os.dup2(write, descriptor)
    os.close(write)
    thread = threading.Thread(target=_forward, args=(read, out), daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.dup2(out, descriptor, inheritable=True)
        thread.join(1.0)  # longer only where another process still writes


def _forward(read: int, out: int) -> None:
    while chunk := os.read(read, _AT_ONCE):
        if select.select([], [out], [], 0)[1]:
            os.write(out, chunk)
