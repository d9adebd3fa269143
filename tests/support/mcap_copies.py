"""Copies of MCAP files in which something is changed or left out."""

from collections.abc import Callable, Mapping
from pathlib import Path

import foxglove

from vlnpe.formats.mcap.recording import open_recording, read_recording


def rewritten(
    path: Path,
    out: Path,
    metadata: Callable[[str, str], str] = lambda name, value: value,
    attachment: Callable[[str, bytes], bytes | None] = lambda name, data: data,
    kept: Mapping[str, int] | None = None,
) -> Path:
    """Write a changed copy of a recording and return its path.

    Args:
        path: the recording.
        out: the copy.
        metadata: changes a value of the record of this name.
        attachment: changes the data of the attachment of this name; None leaves it out.
        kept: number of messages to keep by topic; all of the others are kept.
    """
    contents = read_recording(path)
    with open_recording(out) as recording:
        for name, values in contents.metadata.items():
            recording.writer.write_metadata(name, {k: metadata(name, v) for k, v in values.items()})
        for attached in contents.attachments.values():
            data = attachment(attached.name, attached.data)
            if data is not None:
                recording.writer.attach(
                    log_time=0,
                    create_time=0,
                    name=attached.name,
                    media_type=attached.media_type,
                    data=data,
                )
        for name, messages in contents.messages.items():
            channel = contents.channels[messages[0].channel_id]
            schema = contents.schemas[channel.schema_id]
            made = foxglove.Channel(
                name,
                schema=foxglove.Schema(
                    name=schema.name, encoding=schema.encoding, data=schema.data
                ),
                message_encoding=channel.message_encoding,
                context=recording.context,
            )
            for message in messages[: (kept or {}).get(name)]:
                made.log(message.data, log_time=message.log_time)
    return out
