"""Restore videos from the camera's images in an MCAP file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError, Message
from mcap.records import Schema

from ..core.camera import DepthRange
from ..core.errors import FileFormatError, UnknownNameError
from ..rendered.folder import video_name
from ..video.depth_codes import ANY_NEAR_M, codes_to_depth
from ..video.mp4 import write_depth_video
from ..video.mux import write_bitstream
from .camera import DEPTH_TOPIC, RGB_TOPIC
from .depth_images import decode_depth
from .recording import Contents


def extract_videos(
    contents: Contents, path: Path, folder: Path, facts: Mapping[str, Any], count: int
) -> None:
    """Write the colour and the depth video that `facts` (meta.json) names into `folder`."""
    colours = topic_messages(contents, path, RGB_TOPIC, count)
    depths = topic_messages(contents, path, DEPTH_TOPIC, count)
    try:
        rate, depth = facts["frames_per_second"], facts["depth"]
        depth_range = DepthRange(depth["near_m"], depth["far_m"])
        formats = {message.format for message in colours}
        if len(formats) != 1:
            raise ValueError(f"{RGB_TOPIC} changes its format: {sorted(formats)}")
        packets = [message.data for message in colours]
        write_bitstream(folder / video_name(facts, "rgb", path), packets, formats.pop(), rate)

        def images():
            for message in depths:
                codes = decode_depth(message.data, message.encoding, depth_range)
                codes = codes.reshape(message.height, message.width)
                yield codes_to_depth(codes, depth_range)

        anything = DepthRange(ANY_NEAR_M, depth_range.far_m)
        write_depth_video(folder / video_name(facts, "depth", path), images(), rate, anything)
    except (KeyError, TypeError, ValueError, UnknownNameError) as error:
        raise FileFormatError(path, f"its images are damaged: {error!r}") from error


def topic_messages(contents: Contents, path: Path, topic: str, count: int) -> list[Any]:
    """Return a topic's `count` messages, decoded by the schema in the file."""
    messages = contents.messages.get(topic, [])
    if len(messages) != count:
        reason = f"{len(messages)} of {count} messages" if messages else "missing"
        raise FileFormatError(path, f"topic {topic}: {reason}")
    channel = contents.channels[messages[0].channel_id]
    try:
        kind = message_class(contents.schemas[channel.schema_id])
        return [kind.FromString(message.data) for message in messages]
    except (KeyError, TypeError, DecodeError) as error:
        raise FileFormatError(path, f"topic {topic} is damaged: {error!r}") from error


def message_class(schema: Schema) -> type[Message]:
    """Return the Protobuf class that a file's schema describes.

    Raises:
        TypeError, KeyError, DecodeError: the schema is damaged.
    """
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
