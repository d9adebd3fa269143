"""The numbers of a robot's log by time, without its images."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from backports.zstd import ZstdError  # rosbags reads chunks with it
from numpy.typing import NDArray
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.errors import ReaderError
from rosbags.serde import SerdeError

from ..core.errors import FileFormatError, one_line
from ..untrusted.files import PARSER_ERRORS
from .bag import NANOSECONDS, STORE
from .topic_map import TopicMap

# A topic's clock that is this far from the recorder's is another clock, not latency.
OTHER_CLOCK_S = 1.0
# What rosbags raises for damaged bags.
BAG_ERRORS = (ReaderError, SerdeError, ZstdError, AssertionError, *PARSER_ERRORS)


@dataclass(frozen=True)
class Track:
    """Values by ascending time since the bag's start.

    Attributes:
        time_s: (N,) [s].
        values: (N, D).
    """

    time_s: NDArray[np.float64]
    values: NDArray[np.float64]

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values interpolated linearly; before the first and after the last, those."""
        columns = [np.interp(times_s, self.time_s, column) for column in self.values.T]
        return np.stack(columns, axis=-1) if columns else np.empty((len(times_s), 0))

    def last_at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the last value of each time; before the first one, NaN."""
        index = np.searchsorted(self.time_s, times_s, side="right") - 1
        values = self.values[np.maximum(index, 0)]
        return np.where((index >= 0)[:, None], values, np.nan)


@dataclass(frozen=True)
class Tracks:
    """What a log holds.

    Attributes:
        odometry: Position [m], quat_wxyz, linear [m/s] and angular [rad/s] velocity (13).
        joint_names, joints: Positions, velocities and efforts (3 J), NaN where not reported.
        command: vx, vy [m/s] and yaw rate [rad/s].
        imu: Specific force [m/s²] and angular rate [rad/s] (6).
        color, depth: Times of the images, without values; empty where there are none.
        camera_info: The first CameraInfo.
        frames: Parent, and position and quat_wxyz (7) in it, by frame.
        color_frame, depth_frame: Frames of the images.
        doubts: Sentences about what was adjusted.
    """

    odometry: Track
    joint_names: tuple[str, ...]
    joints: Track | None
    command: Track | None
    imu: Track | None
    color: Track
    depth: Track | None
    camera_info: Any
    frames: dict[str, tuple[str, Track]]
    color_frame: str
    depth_frame: str
    instruction: str
    doubts: tuple[str, ...]


@dataclass
class _Stamped:
    """Messages of one topic."""

    stamp_ns: list[int] = field(default_factory=list)
    log_ns: list[int] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)


def messages(path: Path, topics: tuple[str, ...]) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield topic, type, log time [ns] and CDR bytes of the messages of some topics.

    Raises:
        FileFormatError: If the bag is damaged or not complete.
    """
    try:
        with Reader(path) as reader:
            chosen = [c for c in reader.connections if c.topic in topics]
            expected = sum(c.msgcount for c in chosen)
            count = 0
            for connection, at, data in reader.messages(chosen) if chosen else ():
                count += 1
                yield connection.topic, connection.msgtype, at, bytes(data)
            if count != expected:
                raise FileFormatError(path, f"truncated: {count} of {expected} messages")
    except FileFormatError:
        raise
    except BAG_ERRORS as error:
        raise FileFormatError(path, f"damaged bag: {one_line(error)}") from error


def header_stamp(data: bytes) -> tuple[int, str]:
    """Return the stamp [ns] and the frame of a message that begins with a header."""
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, size = struct.unpack_from(f"{order}iII", data, 4)
    return seconds * NANOSECONDS + nanoseconds, data[16 : 16 + size - 1].decode()


def read_tracks(path: Path, topics: TopicMap) -> Tracks:
    """Read all of a bag but the pixels; memory holds no image.

    Raises:
        FileFormatError: If the bag is damaged, or lacks odometry, colour or its calibration.
    """
    named = (topics.odometry, topics.color, topics.depth, topics.camera_info, topics.joints)
    named = (*named, topics.command, topics.imu, topics.instruction, "/tf", "/tf_static")
    read: dict[str, _Stamped] = {}
    edges: dict[str, tuple[str, _Stamped]] = {}
    images: dict[str, str] = {}
    texts: list[str] = []
    joint_names: tuple[str, ...] = ()
    camera_info = None
    try:
        for topic, kind, at, data in messages(path, named):
            if topic in (topics.color, topics.depth):
                stamp, frame = header_stamp(data)
                images.setdefault(topic, frame)
                _add(read.setdefault(topic, _Stamped()), stamp, at, [])
                continue
            message: Any = STORE.deserialize_cdr(data, kind)
            if topic in ("/tf", "/tf_static"):
                for part in message.transforms:
                    parent, edge = edges.setdefault(
                        part.child_frame_id, (part.header.frame_id, _Stamped())
                    )
                    place = part.transform
                    if parent == part.header.frame_id:
                        values = _place(place.translation, place.rotation)
                        _add(edge, _stamp(part), at, values)
            elif topic == topics.instruction:
                texts.append(message.data)
            elif topic == topics.camera_info:
                camera_info = camera_info or message
            else:
                if topic == topics.joints:
                    joint_names = joint_names or tuple(message.name)
                stamp = _stamp(message) if hasattr(message, "header") else at
                values = _values(topic, topics, message, joint_names)
                _add(read.setdefault(topic, _Stamped()), stamp, at, values)
    except FileFormatError:
        raise
    except BAG_ERRORS as error:
        raise FileFormatError(path, f"a message is damaged: {one_line(error)}") from error
    for topic in (topics.odometry, topics.color):
        if topic not in read:
            raise FileFormatError(path, f"has no messages on {topic}, which every episode needs")
    if camera_info is None:
        raise FileFormatError(path, f"has no calibration on {topics.camera_info}")
    start = min(at for stamped in read.values() for at in stamped.log_ns)
    doubts: list[str] = []

    def track(topic: str) -> Track | None:
        return _track(topic, read[topic], start, doubts) if topic in read else None

    odometry, color = track(topics.odometry), track(topics.color)
    assert odometry is not None and color is not None
    return Tracks(
        odometry=odometry,
        joint_names=joint_names,
        joints=track(topics.joints),
        command=track(topics.command),
        imu=track(topics.imu),
        color=color,
        depth=track(topics.depth),
        camera_info=camera_info,
        frames={
            child: (parent, _track(f"transform to {child}", stamped, start, doubts))
            for child, (parent, stamped) in edges.items()
        },
        color_frame=images[topics.color],
        depth_frame=images.get(topics.depth, ""),
        instruction=texts[0].strip() if texts else "",
        doubts=tuple(doubts),
    )


def _add(stamped: _Stamped, stamp_ns: int, log_ns: int, values: Any) -> None:
    stamped.stamp_ns.append(stamp_ns)
    stamped.log_ns.append(log_ns)
    stamped.values.append(values)


def _track(name: str, stamped: _Stamped, start_ns: int, doubts: list[str]) -> Track:
    """Return values by time; a clock of its own is set to the recorder's."""
    stamps, logs = np.array(stamped.stamp_ns), np.array(stamped.log_ns)
    late = float(np.median(logs - stamps)) / NANOSECONDS
    if abs(late) > OTHER_CLOCK_S and len(stamps) > 1:
        doubts.append(f"{name}: its clock is {late:.3f} s behind the recorder's; shifted")
        stamps = stamps + round(late * NANOSECONDS)
    elif abs(late) > OTHER_CLOCK_S:  # e.g. a static transform of another day
        stamps = logs
    time_s = (stamps - start_ns) / NANOSECONDS
    time_s, first = np.unique(time_s, return_index=True)
    values = np.array(stamped.values, np.float64).reshape(len(stamps), -1)[first]
    return Track(time_s, values)


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return stamp.sec * NANOSECONDS + stamp.nanosec


def _place(at: Any, turn: Any) -> list[float]:
    return [at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z]


def _values(
    topic: str, topics: TopicMap, message: Any, joint_names: tuple[str, ...]
) -> list[float]:
    if topic == topics.odometry:
        pose, twist = message.pose.pose, message.twist.twist
        return [*_place(pose.position, pose.orientation), *_xyz(twist.linear), *_xyz(twist.angular)]
    if topic == topics.joints:
        order = [list(message.name).index(name) for name in joint_names]
        nothing = np.full(len(message.name), np.nan)
        parts = [
            (values if len(values) else nothing)[order]
            for values in (message.position, message.velocity, message.effort)
        ]
        return np.concatenate(parts).tolist()
    if topic == topics.imu:
        return [*_xyz(message.linear_acceleration), *_xyz(message.angular_velocity)]
    twist = getattr(message, "twist", message)
    return [twist.linear.x, twist.linear.y, twist.angular.z]


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]
