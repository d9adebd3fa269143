"""End a command on SIGINT, SIGTERM or SIGHUP within seconds, in one line, without a traceback."""

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TextIO

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PIPE_CLOSED = 128 + signal.SIGPIPE  # what a shell reports of a program that SIGPIPE has ended
GRACE_S = 8.0  # after it, the process ends whatever it is doing


class Interrupted(BaseException):
    """A signal asked the command to end; no `except Exception` may swallow it."""

    def __init__(self, number: int):
        self.signal = signal.Signals(number)
        super().__init__(self.signal.name)

    @property
    def exit_code(self) -> int:
        """128 plus the number of the signal, as shells count."""
        return 128 + self.signal


class DryRun(BaseException):
    """A batch script was written and, as asked, not submitted."""


class OnlyDone(BaseException):
    """The one item that `--only` asked for has run: the command ends.

    Attributes:
        good: Whether it is done; otherwise it was quarantined again.
    """

    def __init__(self, good: bool):
        super().__init__()
        self.good = good


_ends: list[Callable[[], None]] = []  # what must be ended before the process is


@contextlib.contextmanager
def ended_first(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` before a process that does not react to a signal is ended from outside."""
    _ends.append(end)
    try:
        yield
    finally:
        _ends.remove(end)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupted` in the block when a signal arrives, and print one line.

    Every output and every line of a ledger is complete at any moment, so a second signal, or a
    block that has not ended after `GRACE_S`, ends the process at once. Elsewhere than in the main
    thread, where Python handles no signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        if came:
            _end(came[0])
        came.append(number)
        _report(f"{signal.Signals(number).name}: stopping; run the same command again to resume")
        watchdog = threading.Timer(GRACE_S, _end, (number,))
        watchdog.daemon = True
        watchdog.start()
        raise Interrupted(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, handle)
    try:
        yield
    finally:
        # Once stopping, a late signal must not hit the interpreter while it ends.
        if not came:
            for number, handler in before.items():
                signal.signal(number, handler)


@contextlib.contextmanager
def without_interrupts() -> Iterator[None]:
    """Hold back SIGINT in this thread; processes started meanwhile never receive it.

    Otherwise Ctrl-C would print the traceback of a process that is still importing: of a worker, or
    of one that a library starts when it is imported, as GLFW's does.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def closed_streams() -> list[TextIO]:
    """Return which of stdout and stderr are pipes whose reader has gone, as after `| head`."""
    closed = []
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, OSError, ValueError):  # no file behind it
            poll = select.poll()
            poll.register(stream.fileno(), select.POLLERR)
            if poll.poll(0):
                closed.append(stream)
    return closed


def _report(text: str) -> None:
    # Not through `sys.stderr`: the signal may have come while it was being written to.
    with contextlib.suppress(OSError):
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"\nvlnpe: {text}\n".encode())


def _end(number: int) -> None:
    for end in reversed(_ends):
        with contextlib.suppress(Exception):
            end()
    os._exit(128 + number)
