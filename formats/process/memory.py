"""How a process keeps its memory: it asks the system for it, and searches it, less often."""

import contextlib
import ctypes
import gc

# Parameters of glibc's `mallopt`, and what they are set to [bytes].
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
_KEPT, _AHEAD, _LARGE = 1 << 28, 32 << 20, 32 << 20


def keep_memory() -> None:
    """Keep freed memory for the arrays that follow, and look for cycles of objects less often.

    Most of what imports make lasts. Without this a tenth of the CPU time of scans and repairs goes
    into pages that are given back and cleared again.
    """
    gc.set_threshold(10_000)
    with contextlib.suppress(OSError, AttributeError, TypeError):  # other C libraries than glibc
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, value in (
            (_TRIM_THRESHOLD, _KEPT),
            (_TOP_PAD, _AHEAD),
            (_MMAP_THRESHOLD, _LARGE),
        ):
            mallopt(parameter, value)
