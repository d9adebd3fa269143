"""RGB and depth videos in MP4: encode and decode.

Both are written as LeRobot 0.6.1 reads them: short groups of pictures, so that any frame is at
most one decode away from a key frame, and no B-frames, so that decode order is display order and
stream copies keep exact timestamps.
"""

import itertools
import os
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.video.frame import PictureType
from av.video.stream import VideoStream

from ..core.arrays import F32, I64, U8, U16
from ..core.atomic import atomic_file
from ..core.camera import DepthRange
from ..core.errors import FileFormatError
from ..rendered.image_counts import add_depth_codes, add_rgb
from .codecs import DEPTH_CODEC, RGB_CODECS, VideoCodec, check_rgb_codec
from .depth_codes import (
    DEPTH_PIXEL_FORMAT,
    MILLIMETRE_PIXEL_FORMAT,
    codes_to_depth,
    depth_to_codes,
    millimetres_to_codes,
)
from .scheduling import ordinary_threads
from .stream import decode_frames


def write_rgb_video(
    path: Path,
    frames: Iterable[U8],
    frames_per_second: int,
    codec: str | VideoCodec = "h264",
    counts: I64 | None = None,
) -> int:
    """Encode RGB `frames`, each (H, W, 3) uint8, H and W even; return their number.

    Args:
        codec: key of `RGB_CODECS`, or an encoder's settings.
        counts: (3, 256); how often each value occurs in each channel is added to it, so that
            statistics need no decoding (see `image_counts`).

    Raises:
        ValueError: no frame, or a frame of another shape, type or odd size.
        UnknownNameError: `codec` is not in `RGB_CODECS`.
    """
    if isinstance(codec, str):
        check_rgb_codec(codec)
        codec = RGB_CODECS[codec]

    def convert(frame: U8) -> av.VideoFrame:
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
            shape = f"RGB frame of shape {frame.shape} {frame.dtype}"
            raise ValueError(f"{shape}; valid: (H, W, 3) uint8")
        if frame.shape[0] % 2 or frame.shape[1] % 2:
            size = f"{frame.shape[1]} x {frame.shape[0]}"
            raise ValueError(f"frame size {size}; both must be even for yuv420p")
        if counts is not None:
            add_rgb(counts, frame)
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")

    return _encode(path, frames, frames_per_second, codec, convert)


def write_decoded_video(
    path: Path, frames: Iterable[av.VideoFrame], frames_per_second: int, codec: VideoCodec
) -> int:
    """Encode frames of another video; return their number."""

    def convert(frame: av.VideoFrame) -> av.VideoFrame:
        frame.pict_type = PictureType.NONE  # else the encoder makes key frames where they were
        return frame

    return _encode(path, frames, frames_per_second, codec, convert)


def write_depth_video(
    path: Path,
    frames_m: Iterable[F32],
    frames_per_second: int,
    depth_range: DepthRange,
    counts: I64 | None = None,
    on_codes: Callable[[U16], None] | None = None,
) -> int:
    """Encode planar depth, each image (H, W) float32 [m], to 12 bits; return the number of frames.

    Depth is quantised as LeRobot's `quantize_depth` does with `depth_min = 0` and `depth_max =
    far_m` (see `depth_codes`). Readings outside `depth_range` or not finite become 0, invalid.

    Args:
        counts: (4096,); how often each depth code occurs is added to it.
        on_codes: called with the codes (H, W) of each frame.

    Raises:
        ValueError: no frame, or a frame of another shape.
    """

    def convert(depth_m: F32) -> av.VideoFrame:
        if depth_m.ndim != 2:
            raise ValueError(f"depth frame of shape {depth_m.shape}; valid: (H, W)")
        codes = codes_of(depth_m, depth_range, counts, on_codes)
        height, width = codes.shape
        frame = av.VideoFrame(width, height, DEPTH_PIXEL_FORMAT)
        plane = frame.planes[0]
        # Rows are padded in memory; a straight copy would skew the image.
        rows = np.frombuffer(cast(Any, plane), np.uint16).reshape(height, plane.line_size // 2)
        rows[:, :width] = codes
        return frame

    return _encode(path, frames_m, frames_per_second, DEPTH_CODEC, convert)


def codes_of(
    depth_m: F32,
    depth_range: DepthRange,
    counts: I64 | None,
    on_codes: Callable[[U16], None] | None,
) -> U16:
    """Return the codes (H, W) of a depth image, counted and shown as `write_depth_video` says."""
    codes = depth_to_codes(depth_m, depth_range)
    if counts is not None:
        add_depth_codes(counts, codes)
    if on_codes is not None:
        on_codes(codes)
    return codes


def iterate_rgb_video(path: Path) -> Iterator[U8]:
    """Decode an RGB video frame by frame, each (H, W, 3) uint8."""
    for frame in decode_frames(path):
        yield cast(U8, frame.to_ndarray(format="rgb24"))


def iterate_depth_video(path: Path, depth_range: DepthRange) -> Iterator[F32]:
    """Decode a depth video of a range to images, each (H, W) float32 [m], 0 = invalid."""
    for codes in iterate_depth_codes(path, depth_range):
        yield codes_to_depth(codes, depth_range)


def iterate_depth_codes(path: Path, depth_range: DepthRange) -> Iterator[U16]:
    """Decode a depth video frame by frame to its codes, each (H, W) uint16; see `depth_codes`."""
    return (codes_of_frame(path, frame, depth_range) for frame in decode_frames(path))


def codes_of_frame(path: Path, frame: av.VideoFrame, depth_range: DepthRange) -> U16:
    """Return the codes (H, W) uint16 of a frame of a depth video: they, or whole millimetres.

    Raises:
        FileFormatError: the video holds neither.
    """
    name = frame.format.name
    if name == DEPTH_PIXEL_FORMAT:
        return cast(U16, frame.to_ndarray(format=name))
    if name != MILLIMETRE_PIXEL_FORMAT:
        valid = f"{DEPTH_PIXEL_FORMAT} or {MILLIMETRE_PIXEL_FORMAT}"
        raise FileFormatError(path, f"pixel format {name}, a depth video has {valid}")
    try:
        return millimetres_to_codes(cast(U16, frame.to_ndarray(format=name)), depth_range)
    except ValueError as error:
        raise FileFormatError(path, str(error)) from error


def read_rgb_video(path: Path) -> U8:
    """Decode a whole RGB video, (T, H, W, 3) uint8."""
    return np.stack(list(iterate_rgb_video(path)))


def read_depth_video(path: Path, depth_range: DepthRange) -> F32:
    """Decode a whole depth video, (T, H, W) float32 [m]; see `iterate_depth_video`."""
    return np.stack(list(iterate_depth_video(path, depth_range)))


def _encode(
    path: Path, frames: Iterable[Any], frames_per_second: int, codec: VideoCodec, convert: Any
) -> int:
    images = map(convert, frames)
    first: av.VideoFrame | None = next(images, None)
    if first is None:
        raise ValueError(f"no frame to write to {path}")
    if codec.encoder == "libsvtav1":
        os.environ.setdefault("SVT_LOG", "1")  # errors only; else stderr hears of each video
    size, count = (first.width, first.height), 0
    tick = Fraction(1, frames_per_second)  # the muxer changes the stream's own time base
    with (
        ordinary_threads() as restore,
        atomic_file(path) as temporary,
        av.open(str(temporary), "w", format="mp4") as container,
    ):
        options = codec.options()
        added = container.add_stream(codec.encoder, rate=frames_per_second, options=options)
        stream = cast(VideoStream, added)
        stream.width, stream.height = size
        stream.pix_fmt = codec.pixel_format
        stream.time_base = tick
        stream.codec_context.thread_count = 1
        for image in itertools.chain([first], images):
            if (image.width, image.height) != size:
                raise ValueError(
                    f"frame {count} has {image.width} x {image.height} px, the first {size}"
                )
            image.pts, image.time_base = count, tick
            container.mux(stream.encode(image))
            if count == 0:  # the encoder starts with its first frame
                restore()
            count += 1
        container.mux(stream.encode(None))
    return count
