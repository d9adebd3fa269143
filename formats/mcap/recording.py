"""Write MCAP files, and read whole ones with every checksum verified."""

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import foxglove
import zstandard
from foxglove.mcap import MCAPCompression, MCAPWriteOptions, MCAPWriter
from foxglove.messages import Timestamp
from mcap.exceptions import McapError
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from ..core.atomic import atomic_file
from ..core.errors import FileFormatError, brief
from ..untrusted.files import PARSER_ERRORS, read_input
from ..untrusted.limits import limits

NANOSECONDS = 1_000_000_000
# No threads: episodes are written in parallel. Level 1 makes writing an episode with depth 1.25
# times as fast as the default 3, for 6 % more bytes.
OPTIONS = MCAPWriteOptions(
    compression=MCAPCompression.Zstd, compression_threads=0, compression_level=1, chunk_size=1 << 20
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
    """Return the simulation time [s] as a log time [ns]."""
    return round(float(time_s) * NANOSECONDS)


def timestamp(time_s: float) -> Timestamp:
    """Return the simulation time [s] as a message's time stamp."""
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

    def add(self, record: McapRecord) -> None:
        """Add a record; those of other kinds (indexes, headers) are left out."""
        match record:
            case Message():
                topic = self.channels[record.channel_id].topic
                self.messages.setdefault(topic, []).append(record)
            case Channel():
                self.channels[record.id] = record
            case Schema():
                self.schemas[record.id] = record
            case Metadata():
                self.metadata[record.name] = record.metadata
            case Attachment():
                self.attachments[record.name] = record
            case _:
                pass


def _check_chunk(path: Path, chunk: Chunk, unpacked: int, cap: int) -> None:
    """Refuse a chunk before it is decompressed if that would take too much memory.

    The decompressor believes the size in the compressed data, not the one beside it.
    """
    if unpacked > cap:
        size = f"{unpacked:,} bytes; valid: up to {cap:,} (limit mcap_bytes)"
        raise FileFormatError(path, f"its chunks unpack to {size}")
    if chunk.compression == "zstd":
        inside = zstandard.frame_content_size(chunk.data)
        if inside > chunk.uncompressed_size:
            declared = f"{chunk.uncompressed_size:,} unpacked bytes"
            raise FileFormatError(path, f"a chunk declares {declared}, but has {inside:,}")
    elif chunk.compression:
        method = brief(chunk.compression)
        raise FileFormatError(path, f"chunks compressed with {method}; valid: zstd, uncompressed")


def read_recording(path: Path) -> Contents:
    """Read a whole file, checking chunk, data and attachment checksums and the message count."""
    contents, counted, ended = Contents(), None, False
    cap = limits().mcap_bytes
    unpacked = 0
    data = read_input(path, max_bytes=cap)
    try:
        for record in StreamReader(
            io.BytesIO(data), validate_crcs=True, emit_chunks=True, record_size_limit=len(data)
        ).records:
            if isinstance(record, Chunk):
                unpacked += record.uncompressed_size
                _check_chunk(path, record, unpacked, cap)
                for inner in breakup_chunk(record, validate_crc=True):
                    contents.add(inner)
            elif isinstance(record, Statistics):
                counted = record.message_count
            elif isinstance(record, Footer):
                ended = True
            else:
                contents.add(record)
    except CRCValidationError as error:
        raise FileFormatError(path, f"corrupt: {error}") from error
    except (McapError, zstandard.ZstdError, *PARSER_ERRORS) as error:
        raise FileFormatError(path, f"truncated or corrupt MCAP ({error!r})") from error
    count = sum(len(messages) for messages in contents.messages.values())
    if not ended or counted != count:
        raise FileFormatError(path, f"truncated: {count} of {counted} messages")
    return contents
