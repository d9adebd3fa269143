"""Write a bag of ROS 2."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..core.errors import MissingExtraError

try:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise MissingExtraError("ROS 2", "ros2") from error

# Humble's rosbag2 reads no later metadata, and later ones read this.
METADATA_VERSION = 8
STORE = get_typestore(Stores.ROS2_HUMBLE)
NANOSECONDS = 1_000_000_000

# A message to write: its time [ns], and how.
Write = tuple[int, Callable[[], None]]
# Returns what writes a message of a time [ns] on a topic.
Topic = Callable[[int, Any], Write]


def full_name(kind: str) -> str:
    """Return `nav_msgs/msg/Odometry` of `nav_msgs/Odometry`."""
    return kind.replace("/", "/msg/")


class Bag:
    """An open bag."""

    def __init__(self, writer: BagWriter):
        self._writer = writer

    def topic(self, name: str, kind: str, *, latched: bool = False) -> Topic:
        """Add a topic.

        Args:
            kind: Type, e.g. `nav_msgs/Odometry`.
            latched: Whether subscribers that come later get the last message, too.
        """
        full, offered = full_name(kind), [_quality(latched)]
        connection = self._writer.add_connection(
            name, full, typestore=STORE, offered_qos_profiles=offered
        )

        def write(at_ns: int, message: Any) -> Write:
            return at_ns, lambda: self._writer.write(
                connection, at_ns, STORE.serialize_cdr(message, full)
            )

        return write


@contextlib.contextmanager
def open_bag(folder: Path) -> Iterator[Bag]:
    """Write a bag into a new folder that `ros2 bag play -s mcap` takes."""
    writer = BagWriter(folder, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        yield Bag(writer)


def _quality(latched: bool) -> Qos:
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    forever = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1 if latched else 10,
        QosReliability.RELIABLE,
        durability,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        avoid_ros_namespace_conventions=False,
    )
