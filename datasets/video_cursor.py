"""Frames of a video by number: opened once, decoded on from where the last request ended."""

import os
from collections import OrderedDict
from collections.abc import Callable, Iterator
from pathlib import Path

import av
from av.error import FFmpegError

from ..formats.core.errors import FileFormatError
from ..formats.video.stream import open_container

# Decoding on over this many unwanted frames is cheaper than seeking: key frames are 2 apart.
_NEAR = 2


class VideoCursor:
    """An open video and its decoder's position."""

    def __init__(self, path: Path, frames_per_second: int):
        """Open `path`.

        Raises:
            FileFormatError: missing or damaged.
        """
        self._path, self._rate = path, frames_per_second
        self._container = open_container(path)
        self._stream = self._container.streams.video[0]
        # Loaders run one process per core; a decoder's own threads would only fight with them.
        self._stream.codec_context.thread_count = 1
        self._tick_s = float(self._stream.time_base or 1)
        self._frames: Iterator[av.VideoFrame] = iter(())
        self._next = -1

    def frames(self, first: int, count: int) -> Iterator[av.VideoFrame]:
        """Yield `count` frames from frame `first` of the file on.

        Raises:
            FileFormatError: frames are missing or corrupt.
        """
        if not 0 <= first - self._next <= _NEAR or self._next < 0:
            self._seek(first)
        stop = first + count
        while self._next < stop:
            try:
                frame = next(self._frames)
            except (StopIteration, FFmpegError) as error:
                self._next = -1
                raise FileFormatError(
                    self._path, f"frame {max(first, self._next)} cannot be decoded"
                ) from error
            number = round((frame.pts or 0) * self._tick_s * self._rate)
            self._next = number + 1
            if number > first:
                self._next = -1
                raise FileFormatError(self._path, f"frame {first} is missing")
            if number == first:
                first += 1
                yield frame

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def _seek(self, frame: int) -> None:
        # Half a frame ahead, so that rounding never lands behind the frame.
        time = (frame + 0.5) / self._rate / self._tick_s
        try:
            self._container.seek(int(time), stream=self._stream, backward=True, any_frame=False)
        except FFmpegError as error:
            raise FileFormatError(self._path, f"frame {frame} cannot be found") from error
        self._frames = self._container.decode(self._stream)
        self._next = 0


class OpenVideos:
    """At most `limit` open videos; each process opens its own."""

    def __init__(self, limit: int = 32):
        self._limit = limit
        self._open: OrderedDict[tuple[int, Path], VideoCursor] = OrderedDict()

    def cursor(self, path: Path, frames_per_second: int) -> VideoCursor:
        """Return the cursor of `path`; the least recently used one is closed."""
        # Forked workers inherit the parent's cursors, whose file position is shared: not theirs.
        key = (os.getpid(), path)
        if key not in self._open:
            while len(self._open) >= self._limit:
                (owner, _), old = self._open.popitem(last=False)
                if owner == os.getpid():
                    old.close()
            self._open[key] = VideoCursor(path, frames_per_second)
        self._open.move_to_end(key)
        return self._open[key]

    def __reduce__(self) -> "tuple[Callable[[int], OpenVideos], tuple[int]]":
        """Support pickling: a spawned worker opens its own videos."""
        return OpenVideos, (self._limit,)
