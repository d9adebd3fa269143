"""Messages of a robot's log, as its bag has them."""

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

from backports.zstd import ZstdError  # rosbags reads chunks with it
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError
from rosbags.serde import SerdeError

from ..core.errors import FileFormatError, one_line
from ..untrusted.files import PARSER_ERRORS, check_input, check_links
from .bag import NANOSECONDS

# What rosbags raises for damaged bags.
BAG_ERRORS = (ReaderError, SerdeError, ZstdError, AssertionError, *PARSER_ERRORS)
_METADATA = "metadata.yaml"


def bag_name(path: Path) -> str:
    """Return the name of a bag, a folder or a single file."""
    return path.stem if path.is_file() else path.name


def messages(
    path: Path,
    kinds: Mapping[str, tuple[str, ...]],
    required: tuple[str, ...] = (),
    span_ns: tuple[int, int] | None = None,
) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield topic, type, log time [ns] and CDR bytes of the messages of some topics.

    Args:
        kinds: The types that each topic may have.
        required: Topics without which the rest is of no use.
        span_ns: First log time, and the one behind the last [ns]; all by default.

    Raises:
        FileFormatError: If the bag is damaged or not complete, or a topic is missing or of another
            type.
    """
    if path.is_dir():
        check_links(path)
    else:
        check_input(path)
    start, stop = span_ns or (None, None)
    try:
        with Reader(path) as reader:
            kinds_here = {c.topic: c.msgtype for c in reader.connections if c.msgcount}
            _check_topics(path, kinds_here, kinds, required)
            expected = sum(c.msgcount for c in reader.connections if c.topic in kinds)
            chosen, count = [c for c in _stored(reader) if c.topic in kinds], 0
            for connection, at, data in reader.messages(chosen, start, stop) if chosen else ():
                count += 1
                yield connection.topic, connection.msgtype, at, bytes(data)
            if span_ns is None and count != expected:
                raise FileFormatError(path, f"truncated: {count} of {expected} messages")
    except FileFormatError:
        raise
    except BAG_ERRORS as error:
        reason = f"damaged bag: {one_line(error).rstrip('.')}"
        if not (path / _METADATA).is_file():
            reason += "; `ros2 bag reindex` or `mcap recover` mends what a recorder left unfinished"
        raise FileFormatError(path, reason) from error


def _stored(reader: Reader) -> list[Connection]:
    """Return the connections as the storage files have them.

    Those of the metadata may have another quality of service (`ros2 bag convert` writes it nowhere
    else), and rosbags would find no message of theirs.
    """
    storages = getattr(reader.storage, "storages", None)
    return reader.connections if storages is None else [c for s in storages for c in s.connections]


def _check_topics(
    path: Path,
    kinds_here: Mapping[str, str],
    kinds: Mapping[str, tuple[str, ...]],
    required: tuple[str, ...],
) -> None:
    for topic, valid in kinds.items():
        if topic in required and topic not in kinds_here:
            others = ", ".join(name for name, kind in kinds_here.items() if kind in valid)
            where = f"topics of that type: {others or 'none'}"
            raise FileFormatError(path, f"has no {valid[0]} on {topic!r}; {where}")
        if topic in kinds_here and kinds_here[topic] not in valid:
            reason = f"{topic} is of type {kinds_here[topic]}; valid: {', '.join(valid)}"
            raise FileFormatError(path, reason)


def header_stamp(data: bytes) -> tuple[int, str]:
    """Return the stamp [ns] and the frame of a message that begins with a header."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, size = struct.unpack_from(f"{order}iII", data, 4)
    return seconds * NANOSECONDS + nanoseconds, data[16 : 16 + size - 1].decode()


def stamp_lead_ns(data: bytes, log_ns: int) -> int:
    """Return how far the stamp of a message that begins with a header is ahead of its log time.

    It is rounded as an array of floats keeps it, so that it can be compared with such a one.
    """
    return int(float(header_stamp(data)[0] - log_ns))
