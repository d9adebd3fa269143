"""What an MCAP file shows around the recorded states: the scene's map, and the robot's body.

Both are made from the scene and the robot, which formats do not know; so they come as encoded
messages, and converters hand them on as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import foxglove

from .recording import Contents, Recording
from .topics import Write

MAP_TOPIC = "/map"
ROBOT_TOPIC = "/robot"
LINK_TOPIC = "/robot/tf"
TOPICS = (MAP_TOPIC, ROBOT_TOPIC, LINK_TOPIC)


@dataclass(frozen=True)
class ShownTopic:
    """All messages of one topic, of one Protobuf schema.

    Attributes:
        topic: one of `TOPICS`.
        schema_name, schema_data: the message's type, and its serialised FileDescriptorSet.
        messages: (log time [ns], encoded message), in order.
    """

    topic: str
    schema_name: str
    schema_data: bytes
    messages: tuple[tuple[int, bytes], ...]


def shown_messages(recording: Recording, shown: ShownTopic) -> Iterator[Write]:
    """The messages of a topic, as they are."""
    channel = foxglove.Channel(
        shown.topic,
        schema=foxglove.Schema(name=shown.schema_name, encoding="protobuf", data=shown.schema_data),
        message_encoding="protobuf",
        context=recording.context,
    )
    for at, data in shown.messages:
        yield at, lambda at=at, data=data: channel.log(data, log_time=at)


def extract_shown(contents: Contents) -> tuple[ShownTopic, ...]:
    """The topics that a file has of `TOPICS`."""
    found = []
    for topic in TOPICS:
        messages = contents.messages.get(topic)
        if not messages:
            continue
        schema = contents.schemas[contents.channels[messages[0].channel_id].schema_id]
        data = tuple((message.log_time, bytes(message.data)) for message in messages)
        found.append(ShownTopic(topic, schema.name, schema.data, data))
    return tuple(found)
