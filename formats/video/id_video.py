"""Integer images (labels, objects, whole millimetres) as a lossless video: 16-bit PNG in a .mov.

Every frame stands alone, so that any of them is one decode away, and any FFmpeg, OpenCV or player
reads them.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.container import OutputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from ..core.arrays import U16
from ..core.atomic import atomic_file
from ..core.errors import FileFormatError
from .stream import decode_frames

CODEC = "png"
PIXEL_FORMAT = "gray16be"
MAX_ID = 65535


class IdVideoWriter:
    """Writes a video (.mov) frame by frame; the file appears only once it is complete."""

    def __init__(self, path: Path, frames_per_second: int):
        self._path, self._rate = path, frames_per_second
        self._stack = contextlib.ExitStack()
        self._container: OutputContainer | None = None
        self._stream: VideoStream | None = None
        self._count = 0

    def __enter__(self) -> "IdVideoWriter":
        temporary = self._stack.enter_context(atomic_file(self._path))
        self._container = self._stack.enter_context(av.open(str(temporary), "w", format="mov"))
        return self

    def write(self, ids: NDArray[np.integer]) -> None:
        """Append a frame (H, W) of values 0 … 65535.

        Raises:
            ValueError: another shape than the first frame's, or a value out of range.
        """
        assert self._container is not None
        if ids.ndim != 2 or ids.min() < 0 or ids.max() > MAX_ID:
            raise ValueError(f"frame {ids.shape} {ids.dtype}; valid: (H, W) of 0 … {MAX_ID}")
        if self._stream is None:
            stream = self._container.add_stream(CODEC, rate=self._rate)
            self._stream = cast(VideoStream, stream)
            self._stream.height, self._stream.width = ids.shape
            self._stream.pix_fmt = PIXEL_FORMAT
            self._stream.codec_context.thread_count = 1
        if ids.shape != (self._stream.height, self._stream.width):
            raise ValueError(f"frame {self._count} has shape {ids.shape}, unlike the first")
        image = np.ascontiguousarray(ids, dtype=np.uint16)
        frame = av.VideoFrame.from_ndarray(image, format="gray16le")
        frame.pts = self._count
        self._container.mux(self._stream.encode(frame))
        self._count += 1

    def __exit__(self, kind: type[BaseException] | None, *details: Any) -> None:
        """Close the file; after an error nothing is left."""
        if kind is None and self._stream is not None and self._container is not None:
            self._container.mux(self._stream.encode(None))
        self._stack.__exit__(kind, *details)


def iterate_id_video(path: Path) -> Iterator[U16]:
    """Decode a video of integers frame by frame, each (H, W) uint16."""
    for frame in decode_frames(path):
        if frame.format.name != PIXEL_FORMAT:
            raise FileFormatError(
                path, f"pixel format {frame.format.name}, a video of ids has {PIXEL_FORMAT}"
            )
        yield cast(U16, frame.to_ndarray(format="gray16le"))


def read_id_video(path: Path) -> U16:
    """Decode a whole video of integers, (T, H, W) uint16."""
    return np.stack(list(iterate_id_video(path)))
