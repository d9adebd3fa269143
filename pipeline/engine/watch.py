"""A stage's progress bar that also advances while a long item is being done."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from tqdm import tqdm

from ...formats.core.part_done import EVERY_S, part_done
from .work import WorkItem

MOST = 100  # items that are looked after; a bar of more advances often enough by itself


class Watch:
    """Counts items that are done, and parts of those that tell how far they are."""

    def __init__(self, bar: tqdm, items: Sequence[WorkItem]):
        """Take the bar, and the items that are about to run and may tell."""
        self._bar, self._done = bar, int(bar.n)
        self._open = {item.name: item.outputs[0] for item in items if item.outputs}
        self._lock = threading.Lock()

    def count(self, item: WorkItem, note: str) -> None:
        """Count an item that has ended; `note` follows the counts."""
        with self._lock:
            self._open.pop(item.name, None)
            self._done += 1
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.n = self._now()
            self._bar.update(0)

    def look(self) -> None:
        """Advance by what the items tell; not back where one has ended and tells no more."""
        with self._lock:
            now = self._now()
            if now > self._bar.n:
                self._bar.n = now
                self._bar.refresh()

    def _now(self) -> float:
        parts = sum(map(part_done, self._open.values()))
        return round(self._done + parts, 2) if parts else self._done


@contextmanager
def watched(bar: tqdm, items: Sequence[WorkItem]) -> Iterator[Watch]:
    """Look after items until the block ends, in a thread where there is a bar to see."""
    telling = items if len(items) <= MOST and not bar.disable else ()
    watch, ended = Watch(bar, telling), threading.Event()

    def look_again() -> None:
        while not ended.wait(EVERY_S):
            watch.look()

    thread = threading.Thread(target=look_again, daemon=True)
    if telling:
        thread.start()
    try:
        yield watch
    finally:
        ended.set()
        if telling:
            thread.join()
