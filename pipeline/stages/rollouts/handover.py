"""Results that stay in memory for the next job of an episode, if one worker runs both.

Reading a rollout takes a tenth as long as walking it, and decoding depth four tenths as long as
encoding it. Files count, not what was meant to be in them: if one was replaced since, it is read.
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....formats.core.rollout import Rollout
from ....formats.mcap.rollout import read_rollout

MOST_BYTES = 64 << 20  # of one episode's depth; longer ones are decoded

Stamp = tuple[int, ...]


class DepthKeeper:
    """Keeps the depth codes of one rendered episode.

    Jobs of one episode share a keeper, also in a worker: they are pickled together.
    """

    def __init__(self) -> None:
        self._codes: list[NDArray[np.uint16]] = []
        self._bytes = 0
        self._stamp: Stamp | None = None

    def add(self, codes: NDArray[np.uint16]) -> None:
        """Keep the codes (H, W) of the next frame."""
        self._bytes += codes.nbytes
        if self._bytes <= MOST_BYTES:
            self._codes.append(codes)
        else:
            self._codes.clear()

    def end(self, video: Path) -> None:
        """Say which video holds the frames."""
        self._stamp = _stamp(video)

    def of(self, video: Path) -> list[NDArray[np.uint16]] | None:
        """Return the codes of each frame of a video, if they are known."""
        current = self._stamp is not None and self._stamp == _stamp(video)
        return self._codes if current and self._codes else None


def rollout_at(path: Path) -> Rollout:
    """Return `read_rollout`; the last one is kept, and must not be changed."""
    return _read(path, _stamp(path))


@lru_cache(maxsize=1)
def _read(path: Path, stamp: Stamp | None) -> Rollout:
    return read_rollout(path)


def _stamp(path: Path) -> Stamp | None:
    """Return what changes whenever a file is replaced or written to; None if it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    # Not the time of the inode's change: linking a file changes that.
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
