"""How much of an item is done, told by the worker that does it to the process that waits for it.

Through a file beside the item's output, because workers of every kind share its folder.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .atomic import TEMPORARY_PREFIX

EVERY_S = 1.0  # how often the file is written, and read


@contextmanager
def telling(out: Path) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes how much of `out` is done (0 to 1), for `part_done` elsewhere."""
    path, told_s = _beside(out), -math.inf

    def tell(part: float) -> None:
        nonlocal told_s
        now_s = time.monotonic()
        if now_s - told_s >= EVERY_S:
            told_s = now_s
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
