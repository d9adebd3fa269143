"""Open an MCAP file for writing and read one whole, with every checksum checked."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import foxglove
import zstandard
from foxglove.mcap import MCAPCompression, MCAPWriteOptions, MCAPWriter
from foxglove.messages import Timestamp
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, Message, Metadata, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader

from ..core.atomic import atomic_file
from ..core.errors import FileFormatError

NANOSECONDS = 1_000_000_000
# No threads: episodes are written in parallel.
OPTIONS = MCAPWriteOptions(
    compression=MCAPCompression.Zstd, compression_threads=0, chunk_size=1 << 20
)


@dataclass(frozen=True)
class Recording:
    """An open MCAP file.

    Attributes:
        context: channels are made in it.
        writer: for metadata and attachments.
    """

    context: foxglove.Context
    writer: MCAPWriter


@contextlib.contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Write an MCAP file atomically: zstd chunks, indexes, checksums.

    The data section follows from what is written alone: times come from the simulation, and each
    file has a context of its own. (In the summary behind it, the SDK repeats schemas and channels
    in random order.)
    """
    context = foxglove.Context()
    with (
        atomic_file(path) as temporary,
        foxglove.open_mcap(
            temporary, allow_overwrite=True, context=context, writer_options=OPTIONS
        ) as writer,
    ):
        yield Recording(context, writer)


def nanoseconds(time_s: float) -> int:
    """Simulation time [s] as a log time [ns]."""
    return round(float(time_s) * NANOSECONDS)


def timestamp(time_s: float) -> Timestamp:
    """Simulation time [s] as a message's time stamp."""
    sec, nsec = divmod(nanoseconds(time_s), NANOSECONDS)
    return Timestamp(sec, nsec)


@dataclass
class Contents:
    """Everything in an MCAP file, in file order.

    Attributes:
        schemas, channels: by id.
        messages: by topic.
        metadata: by name.
        attachments: by name.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: dict[str, list[Message]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, Attachment] = field(default_factory=dict)


def read_recording(path: Path) -> Contents:
    """Read a whole file, checking chunk, data and attachment checksums and the message count.

    Raises:
        FileFormatError: missing, truncated or corrupt.
    """
    contents, counted, ended = Contents(), None, False
    try:
        stream = io.BytesIO(path.read_bytes())
        for record in StreamReader(stream, validate_crcs=True).records:
            match record:
                case Message():
                    topic = contents.channels[record.channel_id].topic
                    contents.messages.setdefault(topic, []).append(record)
                case Channel():
                    contents.channels[record.id] = record
                case Schema():
                    contents.schemas[record.id] = record
                case Metadata():
                    contents.metadata[record.name] = record.metadata
                case Attachment():
                    contents.attachments[record.name] = record
                case Statistics():
                    counted = record.message_count
                case Footer():
                    ended = True
                case _:
                    pass
    except CRCValidationError as error:
        raise FileFormatError(path, f"corrupt: {error}") from error
    except OSError as error:
        raise FileFormatError(path, f"not readable ({error.strerror or error})") from error
    except (
        McapError,
        struct.error,
        zstandard.ZstdError,
        RuntimeError,
        ValueError,
        KeyError,
        IndexError,
        OverflowError,
        MemoryError,
    ) as error:
        # A damaged length or text makes the reader stumble in many ways.
        raise FileFormatError(path, f"truncated or corrupt MCAP ({error!r})") from error
    found = sum(len(messages) for messages in contents.messages.values())
    if not ended or counted != found:
        raise FileFormatError(path, f"truncated: {found} of {counted} messages")
    return contents
