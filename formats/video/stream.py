"""Open videos, and read their packets and frames, noticing what is damaged or missing."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
from av.container import InputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream

from ..core.errors import FileFormatError
from ..untrusted.files import check_input


@dataclass(frozen=True)
class VideoFacts:
    """Properties of a video. `frames` is the number of packets."""

    width_px: int
    height_px: int
    codec: str
    pixel_format: str
    frames_per_second: int
    frames: int


def probe_video(path: Path) -> VideoFacts:
    """Read a video's header."""
    with open_video(path) as container:
        stream = container.streams.video[0]
        return VideoFacts(
            width_px=stream.width,
            height_px=stream.height,
            codec=stream.codec.canonical_name,
            pixel_format=stream.pix_fmt or "",
            frames_per_second=round(float(stream.average_rate or 0)),
            frames=stream.frames,
        )


@contextlib.contextmanager
def open_video(path: Path) -> Iterator[InputContainer]:
    """Open a file that has a video stream, and close it at the end."""
    with contextlib.closing(open_container(path)) as container:
        yield container


def open_container(path: Path) -> InputContainer:
    """Return an open file whose first video stream has a known codec; the caller closes it."""
    check_input(path)
    try:
        # As MP4 whatever it says: playlists would have the decoder open other files and hosts.
        container = av.open(str(path.absolute()), format="mp4")
    except (FFmpegError, OSError) as error:
        raise FileFormatError(path, f"not a readable video ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise FileFormatError(path, "not a readable video (its metadata is not text)") from error
    if container.streams.video and container.streams.video[0].codec_context:
        return container
    reason = "its codec is unknown" if container.streams.video else "no video stream"
    container.close()
    raise FileFormatError(path, reason)


def decode_frames(path: Path) -> Iterator[av.VideoFrame]:
    """Yield all frames; a video that lost some must not look like a short one."""
    count = 0
    with open_video(path) as container:
        stream = container.streams.video[0]
        try:
            for frame in container.decode(stream):
                yield frame
                count += 1
        except FFmpegError as error:
            raise FileFormatError(path, f"frame {count} is corrupt ({error.strerror})") from error
        if count != stream.frames or count == 0:
            raise FileFormatError(path, f"truncated: {count} of {stream.frames} frames")


def pick_frames(path: Path, numbers: Sequence[int]) -> Iterator[av.VideoFrame]:
    """Yield the frames of the given ascending numbers, decoding few others."""
    with open_video(path) as container:
        stream = container.streams.video[0]
        ticks = ticks_per_frame(path, stream)
        frames, following = container.decode(stream), 0
        for number in numbers:
            try:
                if number - following not in (0, 1):  # else going on costs less than seeking
                    container.seek(number * ticks, stream=stream, backward=True)
                    frames = container.decode(stream)
                following = number + 1
                frame = next((f for f in frames if f.pts == number * ticks), None)
            except FFmpegError as error:
                raise FileFormatError(path, f"frame {number} is corrupt ({error})") from error
            if frame is None:
                raise FileFormatError(path, f"there is no frame {number}")
            yield frame


def demux_packets(path: Path, part: InputContainer, stream: VideoStream) -> Iterator[av.Packet]:
    """Yield all packets of an open video, one per frame."""
    count = 0
    for packet in part.demux(stream):
        if packet.dts is None:  # the demuxer's flush
            continue
        if packet.is_corrupt:
            raise FileFormatError(path, f"packet {count} is corrupt")
        yield packet
        count += 1
    if count != stream.frames or count == 0:
        raise FileFormatError(path, f"truncated: {count} of {stream.frames} frames")


def ticks_per_frame(path: Path, stream: VideoStream) -> int:
    """Return the duration of a frame in the stream's time base, which must be a whole number."""
    rate, base = stream.average_rate, stream.time_base
    ticks = Fraction(0) if not rate or not base else 1 / (rate * base)
    if ticks < 1 or ticks.denominator != 1:
        raise FileFormatError(path, f"frame rate {rate} does not fit the time base {base}")
    return int(ticks)


def stream_settings(stream: VideoStream) -> tuple[str, int, int, str, str, str]:
    """Return the settings that must agree between videos joined by copying packets."""
    times = str(stream.average_rate), str(stream.time_base)
    size = stream.width, stream.height
    return stream.codec.canonical_name, *size, str(stream.pix_fmt), *times
