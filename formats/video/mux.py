"""Copy encoded packets: join videos, and convert between videos and bare streams."""

import contextlib
import io
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
from av.bitstream import BitStreamFilterContext
from av.container import InputContainer, OutputContainer
from av.error import FFmpegError
from av.video.stream import VideoStream

from ..core.atomic import atomic_file
from ..core.errors import FileFormatError, check_name
from .stream import demux_packets, open_video, stream_settings, ticks_per_frame

# Codec → FFmpeg's reader of its bare stream, and what must stand before each packet for it.
_RAW_FORMATS = {"h264": ("h264", b""), "av1": ("obu", b"\x12\x00")}
# Parameter sets repeated in the stream: a video file has them once, in its header.
_PARAMETER_SETS = "filter_units=remove_types=7-8"


def write_bitstream(
    path: Path, packets: Sequence[bytes], codec: str, frames_per_second: int
) -> None:
    """Write an MP4 of packets as `iterate_bitstream` yields them, one per frame, unchanged.

    The first packet is a key frame; frame i gets the time i / frames_per_second.

    Raises:
        UnknownNameError: `codec` is neither `h264` nor `av1`.
        ValueError: the packets are no such stream, or not one per frame.
    """
    check_name("video codec", codec, _RAW_FORMATS)
    raw_format, separator = _RAW_FORMATS[codec]
    stream_bytes = b"".join(separator + packet for packet in packets)
    options = {"framerate": str(frames_per_second)}
    try:
        with (
            av.open(io.BytesIO(stream_bytes), format=raw_format, options=options) as raw,
            atomic_file(path) as temporary,
            av.open(str(temporary), "w", format="mp4") as container,
        ):
            stream = cast(InputContainer, raw).streams.video[0]
            output = container.add_stream_from_template(stream, opaque=True)
            tick = output.time_base = Fraction(1, frames_per_second)
            strip = BitStreamFilterContext(_PARAMETER_SETS, stream) if codec == "h264" else None
            count = 0
            for packet in cast(InputContainer, raw).demux(stream):
                if not packet.size:  # the demuxer's flush
                    continue
                for part in strip.filter(packet) if strip else [packet]:
                    part.time_base = tick
                    _append(container, output, part, count, 1)
                    count += 1
            if count != len(packets):
                raise ValueError(f"{len(packets)} packets hold {count} frames")
    except FFmpegError as error:
        raise ValueError(f"not a {codec} stream ({error.strerror})") from error


def copy_frames(path: Path, out: Path, first: int, count: int) -> None:
    """Write frames `first` … `first + count − 1` of a video, from a key frame on, unchanged."""
    with (
        _corrupt_from(path, first),
        open_video(path) as source,
        atomic_file(out) as temporary,
        av.open(str(temporary), "w", format="mp4") as container,
    ):
        stream = source.streams.video[0]
        ticks = ticks_per_frame(path, stream)
        output = container.add_stream_from_template(stream, opaque=True)
        output.time_base = stream.time_base
        source.seek(first * ticks, stream=stream, backward=True)
        done = 0
        for packet in source.demux(stream):
            if not packet.size or packet.pts is None or packet.pts < first * ticks:
                continue
            if packet.pts != (first + done) * ticks or packet.dts != packet.pts:
                raise FileFormatError(path, f"frame {first + done} is not at its regular time")
            if done == 0 and not packet.is_keyframe:
                reason = f"frame {first}, the first of an episode, is not a key frame"
                raise FileFormatError(path, reason)
            _append(container, output, packet, done, ticks)
            done += 1
            if done == count:
                break
        if done != count:
            raise FileFormatError(path, f"frames end at {first + done}; {first + count} needed")


def copy_beginnings(path: Path, outs: Sequence[Path]) -> None:
    """Write the first k + 1 frames of a video, unchanged, to `outs[k]`; not atomically."""
    with _corrupt_from(path, 0), open_video(path) as source:
        stream = source.streams.video[0]
        ticks, base = ticks_per_frame(path, stream), cast(Fraction, stream.time_base)
        packets = list(demux_packets(path, source, stream))
        for count, out in enumerate(outs, start=1):
            with av.open(str(out), "w", format="mp4") as container:
                output = container.add_stream_from_template(stream, opaque=True)
                output.time_base = base
                for frame, packet in enumerate(packets[:count]):
                    packet.time_base = base  # muxing changes it
                    _append(container, output, packet, frame, ticks)


@contextlib.contextmanager
def _corrupt_from(path: Path, first: int) -> Iterator[None]:
    try:
        yield
    except FFmpegError as error:
        raise FileFormatError(path, f"corrupt from frame {first} on ({error.strerror})") from error


def _append(
    container: OutputContainer, output: VideoStream, packet: av.Packet, frame: int, ticks: int
) -> None:
    """Write a packet as the frame of a number; each takes `ticks` of the stream's time base."""
    packet.pts = packet.dts = frame * ticks
    packet.duration, packet.stream = ticks, output
    container.mux(packet)


def iterate_bitstream(path: Path) -> Iterator[bytes]:
    """Yield each frame's bytes as streams carry them, without decoding.

    H.264 comes in Annex B form with parameter sets before each key frame, AV1 as low-overhead
    units: what Foxglove's CompressedVideo wants.
    """
    with open_video(path) as container:
        stream = container.streams.video[0]
        packets = demux_packets(path, container, stream)
        try:
            if stream.codec.canonical_name == "h264":
                annex_b = BitStreamFilterContext("h264_mp4toannexb", stream)
                packets = (out for packet in packets for out in annex_b.filter(packet))
            for packet in packets:
                yield bytes(packet)
        except FFmpegError as error:
            raise FileFormatError(path, f"packets are corrupt ({error.strerror})") from error


def concatenate_videos(paths: list[Path], out: Path) -> list[int]:
    """Join one video or more by copying their packets; return each part's number of frames.

    Frame i of the result has the timestamp i / frames per second, exactly. All parts must come
    from the same encoder settings. Nothing is decoded, and memory stays flat.
    """
    if not paths:
        raise ValueError("no video to concatenate")
    counts: list[int] = []
    with (
        atomic_file(out) as temporary,
        av.open(str(temporary), "w", options={"movflags": "faststart"}) as container,
        open_video(paths[0]) as first,
    ):
        template = first.streams.video[0]
        output = container.add_stream_from_template(template, opaque=True)
        output.time_base = template.time_base
        settings = stream_settings(template)
        extradata = template.codec_context.extradata
        ticks = ticks_per_frame(paths[0], template)
        for path in paths:
            with open_video(path) as part:
                stream = part.streams.video[0]
                if (own := stream_settings(stream)) != settings:
                    raise FileFormatError(path, f"settings {own} differ from {settings}")
                if stream.codec_context.extradata != extradata:
                    raise FileFormatError(path, "encoder parameter sets differ from the first part")
                total, count = sum(counts), 0
                for packet in demux_packets(path, part, stream):
                    if packet.pts != count * ticks or packet.dts != packet.pts:
                        raise FileFormatError(path, f"frame {count} is not at its regular time")
                    _append(container, output, packet, total + count, ticks)
                    count += 1
                counts.append(count)
    return counts
