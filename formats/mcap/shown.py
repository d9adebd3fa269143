"""Topics beside the recorded states: the scene's map, and the robot's body.

Both are made from the scene and the robot, which formats do not know; so they come as encoded
messages, and converters hand them on as they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import foxglove
import numpy as np
from foxglove.messages import Grid, PackedElementField, PackedElementFieldNumericType, Vector2

from ..scene.freemap import Freemap
from .recording import Contents, Recording, nanoseconds, timestamp
from .topics import WORLD_FRAME, Write, pose

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
    """Yield the messages of a topic unchanged."""
    channel = foxglove.Channel(
        shown.topic,
        schema=foxglove.Schema(name=shown.schema_name, encoding="protobuf", data=shown.schema_data),
        message_encoding="protobuf",
        context=recording.context,
    )
    for at, data in shown.messages:
        yield at, lambda at=at, data=data: channel.log(data, log_time=at)


def extract_shown(contents: Contents) -> tuple[ShownTopic, ...]:
    """Return the topics that a file has of `TOPICS`."""
    topics = []
    for topic in TOPICS:
        messages = contents.messages.get(topic)
        if not messages:
            continue
        schema = contents.schemas[contents.channels[messages[0].channel_id].schema_id]
        data = tuple((message.log_time, bytes(message.data)) for message in messages)
        topics.append(ShownTopic(topic, schema.name, schema.data, data))
    return tuple(topics)


# RGBA. Where there is no floor the map is clear.
FREE, BLOCKED, NOTHING = (205, 214, 205, 255), (96, 96, 104, 255), (0, 0, 0, 0)
BELOW_M = 0.02  # so that paths and feet are drawn over it


def map_topic(*maps: tuple[float, Freemap]) -> ShownTopic:
    """Return maps, each from a time [s] on: free floor, floor under something, and no floor."""
    schema = Grid.get_schema()
    messages = ((nanoseconds(at_s), _grid(at_s, freemap).encode()) for at_s, freemap in maps)
    data = tuple((at, bytes(message)) for at, message in messages)
    return ShownTopic(MAP_TOPIC, schema.name, schema.data, data)


def _grid(at_s: float, freemap: Freemap) -> Grid:
    floor = np.isfinite(freemap.floor_z_m)
    kind = np.where(floor, np.where(freemap.traversable, 0, 1), 2)
    colors = np.array([FREE, BLOCKED, NOTHING], np.uint8)[kind]
    columns = kind.shape[1]
    x, y = (float(v) for v in freemap.grid.origin_xy_m)
    z = float(np.median(freemap.floor_z_m[floor])) - BELOW_M if floor.any() else 0.0
    fields = [
        PackedElementField(name=name, offset=k, type=PackedElementFieldNumericType.Uint8)
        for k, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    return Grid(
        timestamp=timestamp(at_s),
        frame_id=WORLD_FRAME,
        pose=pose(np.array([x, y, z]), np.array([1.0, 0.0, 0.0, 0.0])),
        column_count=columns,
        cell_size=Vector2(x=freemap.grid.cell_m, y=freemap.grid.cell_m),
        row_stride=4 * columns,
        cell_stride=4,
        fields=fields,
        data=colors.tobytes(),
    )
