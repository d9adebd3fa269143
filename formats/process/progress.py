"""Progress on stderr: a bar on a terminal, elsewhere a line per tenth or half minute."""

import os
import sys
import time
from collections.abc import Iterable
from threading import Timer
from typing import Any

from tqdm import tqdm

_BAR = "{desc} {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} [{elapsed}<{remaining}]{postfix}"
_LINE = "{desc} {percentage:3.0f}% {n_fmt}/{total_fmt} [{elapsed}<{remaining}]{postfix}"
SILENCE_S = 30.0  # a line is written at least this often
SHORT_S = 2.0  # nothing is written before this, or the end
WIDEST, UNKNOWN_WIDTH = 100, 80  # columns of a bar; of a terminal that does not say how wide it is


def progress_bar(
    name: str,
    total: int,
    *,
    items: Iterable[Any] | None = None,
    initial: int = 0,
    note: str = "",
    show: bool = True,
) -> tqdm:
    """Return a progress bar: a context manager with `update`, and an iterator over `items`.

    Where stderr is no terminal, it writes a line after `SHORT_S`, one whenever another tenth is
    done or `SILENCE_S` have passed, and one for where it was closed.

    Args:
        items: to iterate over; without them, `update` is called by hand.
        initial: number of items that are done already.
        note: follows the counts; `set_postfix_str` changes it.
    """
    options: dict[str, Any] = {"total": total, "initial": initial, "desc": name}
    options |= {"postfix": note, "disable": not show}
    if not sys.stderr.isatty():
        return _Lines(items, bar_format=_LINE, mininterval=0, miniters=1, **options)
    columns = os.get_terminal_size(sys.stderr.fileno()).columns or UNKNOWN_WIDTH
    # tqdm draws nothing on a terminal of unknown height.
    return tqdm(items, bar_format=_BAR, ncols=min(columns, WIDEST) - 1, nrows=2, **options)


class _Lines(tqdm):
    """A bar that never overwrites what it has written."""

    _tenth = -1
    _written = -1
    _written_s = 0.0

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, delay=SHORT_S, **options)
        # The first item may take minutes.
        self._first = Timer(SHORT_S, self.refresh)
        self._first.daemon = True
        if not self.disable:
            self._first.start()

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Write a line if another tenth is done, or nothing has been written for `SILENCE_S`."""
        tenth = 10 * self.n // self.total if self.total else 10
        silent = time.monotonic() - self._written_s > SILENCE_S and self.n != self._written
        if tenth > self._tenth or silent:
            self._tenth = tenth
            self._write()

    def close(self) -> None:
        """Write where it has ended, if no line says so."""
        self._first.cancel()
        if not self.disable and self.n != self._written:
            self._write()
        self.sp = None  # nothing to overwrite or to finish on the screen
        super().close()

    def _write(self) -> None:
        self._written, self._written_s = self.n, time.monotonic()
        self.fp.write(f"{self}\n")
        self.fp.flush()
