"""A stage's progress bar that also advances while a long item is being done.

A worker tells how much of its item is done through a file beside the item's output, because workers
of every kind share its folder.
"""

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from ...formats.core.atomic import TEMPORARY_PREFIX
from ..engine.work import WorkItem

WRITE_EVERY_S = 1.0  # how often a worker writes the file
READ_EVERY_S = 1.0  # how often the files are read
MOST_ITEMS = 100  # items that are looked after; a bar of more advances often enough by itself


@contextmanager
def telling(out: Path) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes how much of `out` is done (0 to 1), for `part_done` elsewhere."""
    path, written_s = _beside(out), -math.inf

    def tell(part: float) -> None:
        nonlocal written_s
        now_s = time.monotonic()
        if now_s - written_s >= WRITE_EVERY_S:
            written_s = now_s
            path.write_text(f"{part:.3f}")

    try:
        yield tell
    finally:
        path.unlink(missing_ok=True)


def part_done(out: Path) -> float:
    """Return how much of an output is done (0 to 1); 0 of one that nothing is told about."""
    try:
        return max(0.0, min(float(_beside(out).read_text()), 1.0))
    except (OSError, ValueError):  # it may be just being written
        return 0.0


def _beside(out: Path) -> Path:
    """Return a name that `sweep_beside` removes after a worker that has died."""
    return out.with_name(f"{TEMPORARY_PREFIX}{out.stem}.part{''.join(out.suffixes)}")


class Watch:
    """Counts items that are done, and parts of those that tell how far they are."""

    def __init__(self, bar: tqdm, items: Sequence[WorkItem]):
        """Take the bar, and the items that are about to run and may tell."""
        self._bar, self._done = bar, int(bar.n)
        self._open = {item.name: item.outputs[0] for item in items if item.outputs}
        self._parts: dict[str, float] = {}  # of open items, as they were last read
        self._lock = threading.Lock()

    def count(self, item: WorkItem, note: str) -> None:
        """Count an item that has ended; `note` follows the counts."""
        with self._lock:
            self._open.pop(item.name, None)
            self._parts.pop(item.name, None)
            self._done += 1
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.n = self._now()
            self._bar.update(0)

    def refresh(self) -> None:
        """Advance by what the items tell; not back where one has ended and tells no more."""
        with self._lock:
            self._parts = {name: part_done(out) for name, out in self._open.items()}
            now = self._now()
            if now > self._bar.n:
                self._bar.n = now
                self._bar.refresh()

    def _now(self) -> float:
        parts = sum(self._parts.values())
        return round(self._done + parts, 2) if parts else self._done


@contextmanager
def watched(bar: tqdm, items: Sequence[WorkItem]) -> Iterator[Watch]:
    """Look after items until the block ends, in a thread where there is a bar to see."""
    unfinished = items if len(items) <= MOST_ITEMS and not bar.disable else ()
    watch, ended = Watch(bar, unfinished), threading.Event()

    def refresh_again() -> None:
        while not ended.wait(READ_EVERY_S):
            watch.refresh()

    thread = threading.Thread(target=refresh_again, daemon=True)
    if unfinished:
        thread.start()
    try:
        yield watch
    finally:
        ended.set()
        if unfinished:
            thread.join()
