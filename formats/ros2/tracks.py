"""The numbers of a robot's log by time, without its images."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import FileFormatError, one_line
from .bag import NANOSECONDS, STORE
from .calibration import add_if_new, check_calibration, fault_of, of_rectified, same_pixels
from .clocks import Stamped, Track, tracks_by_time
from .log import BAG_ERRORS, header_stamp, messages, stamp_lead_ns
from .topic_map import KINDS, TopicMap

TRANSFORMS: dict[str, tuple[str, ...]] = dict.fromkeys(
    ("/tf", "/tf_static"), ("tf2_msgs/msg/TFMessage",)
)


@dataclass(frozen=True)
class Tracks:
    """What a log holds.

    Attributes:
        start_ns: Log time of the first message [ns], from which all times count.
        odometry: Position [m], quat_wxyz, linear [m/s] and angular [rad/s] velocity (13).
        joint_names, joints: Positions, velocities and efforts (3 J), NaN where not reported.
        command: vx, vy [m/s] and yaw rate [rad/s], NaN where it held no numbers.
        imu: Specific force [m/s²] and angular rate [rad/s] (6).
        color, depth: Log times of the images [ns since the start], and stamps less those [ns] (2);
            None where there are none.
        camera_info, depth_info: CameraInfo of the images, and of depth, as they are.
        frames: Parent, and position and quat_wxyz (7) in it, by frame; one that does not move has
            one value.
        color_frame: Frame of the images.
        instructions: Seconds and text of each new instruction.
        doubts: Sentences about what was adjusted.
    """

    start_ns: int
    odometry: Track
    joint_names: tuple[str, ...]
    joints: Track | None
    command: Track | None
    imu: Track | None
    color: Track
    depth: Track | None
    camera_info: Any
    depth_info: Any
    frames: dict[str, tuple[str, Track]]
    color_frame: str
    instructions: tuple[tuple[float, str], ...]
    doubts: tuple[str, ...]


def read_tracks(path: Path, topics: TopicMap) -> Tracks:
    """Read all of a bag but the pixels; memory holds no image.

    Raises:
        FileFormatError: If the bag is damaged, lacks odometry, colour or its calibration, a topic
            holds something else than it should, or depth is not aligned.
    """
    log = _Log(path, topics)
    required = (topics.odometry, topics.color, topics.camera_info)
    required += (topics.depth_info,) if topics.depth_info else ()
    kinds: dict[str, tuple[str, ...]] = {topics.depth_info_topic: KINDS["camera_info"]}
    kinds |= {getattr(topics, name): k for name, k in KINDS.items()}
    try:
        for topic, kind, at, data in messages(path, kinds | TRANSFORMS, required):
            log.take(topic, kind, at, data)
    except FileFormatError:
        raise
    except BAG_ERRORS as error:
        raise FileFormatError(path, f"a message is damaged: {one_line(error)}") from error
    return log.tracks()


class _Log:
    """What was read of a log so far."""

    def __init__(self, path: Path, topics: TopicMap):
        self._path, self._topics = path, topics
        self._read: dict[str, Stamped] = {}
        self._edges: dict[str, tuple[str, Stamped]] = {}
        self._image_frames: dict[str, str] = {}
        self._joints: dict[tuple[str, ...], Stamped] = {}
        self._texts: list[tuple[int, str]] = []
        self._infos: dict[str, list[Any]] = {}
        self._start_ns = -1

    def take(self, topic: str, kind: str, at: int, data: bytes) -> None:
        """Add a message."""
        topics = self._topics
        if topic not in TRANSFORMS and self._start_ns < 0:
            self._start_ns = at
        if topic in (topics.color, topics.depth):
            (stamp, frame), lead_ns = header_stamp(data), stamp_lead_ns(data, at)
            if frame != self._image_frames.setdefault(topic, frame):
                frames = f"{topic} holds images of {self._image_frames[topic]} and {frame}"
                raise FileFormatError(self._path, f"{frames}; valid: one camera")
            self._stamped(topic).add(stamp, at, [at - self._start_ns, lead_ns])
            return
        message: Any = STORE.deserialize_cdr(data, kind)
        if topic in TRANSFORMS:
            for part in message.transforms:
                self._take_edge(part, at, moves=topic == "/tf")
        elif topic == topics.instruction:
            text = " ".join(message.data.split())
            if text and text != (self._texts[-1][1] if self._texts else ""):
                self._texts.append((at, text))
        elif topic in (topics.camera_info, topics.depth_info_topic):
            add_if_new(self._infos.setdefault(topic, []), message)
        elif topic == topics.joints:
            names = tuple(message.name)
            stamped = self._joints.setdefault(names, Stamped())
            _add(stamped, _stamp(message), at, _joints(message))
        else:
            stamp = _stamp(message) if hasattr(message, "header") else at
            _add(self._stamped(topic), stamp, at, self._values(topic, message))

    def _stamped(self, topic: str) -> Stamped:
        return self._read.setdefault(topic, Stamped())

    def _take_edge(self, part: Any, at: int, *, moves: bool) -> None:
        parent, child = part.header.frame_id, part.child_frame_id
        known, edge = self._edges.setdefault(child, (parent, Stamped()))
        if known != parent:
            return
        if not moves:  # latched, perhaps again and again
            self._edges[child] = parent, (edge := Stamped())
        place = part.transform
        _add(edge, _stamp(part), at, _place(place.translation, place.rotation))

    def _values(self, topic: str, message: Any) -> Sequence[float] | None:
        topics = self._topics
        if topic == topics.odometry:
            child, base = message.child_frame_id, topics.base_frame
            if child and child != base:
                reason = f"{topic} tells where {child} is; valid: base_frame, which is {base}"
                raise FileFormatError(self._path, reason)
            pose, twist = message.pose.pose, message.twist.twist
            place = _place(pose.position, pose.orientation)
            return place and _finite([*place, *_xyz(twist.linear), *_xyz(twist.angular)])
        if topic == topics.imu:
            return _finite([*_xyz(message.linear_acceleration), *_xyz(message.angular_velocity)])
        twist = getattr(message, "twist", message)
        # What a robot does on such a command is not known.
        values = [twist.linear.x, twist.linear.y, twist.angular.z]
        return _finite(values) or [np.nan] * 3

    def tracks(self) -> Tracks:
        """Return all that was read."""
        topics, doubts = self._topics, list[str]()
        color_frame = self._image_frames[topics.color]
        depth_frame = self._image_frames.get(topics.depth, "")
        of_color = self._infos[topics.camera_info]
        of_color = check_calibration(self._path, topics.camera_info, of_color, color_frame)
        if topics.depth in self._read and depth_frame != color_frame:
            frames = f"depth in {depth_frame!r}, colour in {color_frame!r}"
            raise FileFormatError(self._path, f"{frames}; valid: depth aligned to colour")
        camera_info = _as_stored(topics.color, of_color, doubts)
        depth_info = camera_info
        if topics.depth in self._read:
            depth_info = self._depth_camera_info(of_color, camera_info, doubts)
        joints = max(self._joints, key=lambda names: len(self._joints[names].values), default=())
        if self._joints:
            self._read[topics.joints] = self._joints.pop(joints)
        for others in self._joints:
            doubts.append(f"{topics.joints}: messages with other joints left out: {others[:3]} …")

        edges = {child: f"transform to {child}" for child in self._edges}
        moves = {name: self._edges[child][1] for child, name in edges.items()}
        by_name = tracks_by_time(self._read | moves, self._start_ns, doubts)
        if topics.odometry not in by_name:
            raise FileFormatError(self._path, f"{topics.odometry}: no message holds a pose")
        return Tracks(
            start_ns=self._start_ns,
            odometry=by_name[topics.odometry],
            joint_names=joints,
            joints=by_name.get(topics.joints),
            command=by_name.get(topics.command),
            imu=by_name.get(topics.imu),
            color=by_name[topics.color],
            depth=by_name.get(topics.depth),
            camera_info=camera_info,
            depth_info=depth_info,
            frames={
                child: (self._edges[child][0], by_name[name])
                for child, name in edges.items()
                if name in by_name
            },
            color_frame=color_frame,
            instructions=tuple(
                ((at - self._start_ns) / NANOSECONDS, text) for at, text in self._texts
            ),
            doubts=tuple(doubts),
        )

    def _depth_camera_info(self, of_color: Any, camera_info: Any, doubts: list[str]) -> Any:
        """Return the CameraInfo of depth; it may differ from colour's, in the same frame.

        Args:
            of_color: The CameraInfo of colour's topic; `camera_info` is that of its images.
        """
        topic, own_topic = self._topics.depth, self._topics.depth_info_topic
        infos = self._infos.get(own_topic, [of_color])
        if fault := fault_of(infos, self._image_frames[topic]):
            doubts.append(f"{own_topic}: {fault}; colour's is taken for depth")
            infos = [of_color]
        own = _as_stored(topic, infos[0], doubts)
        if same_pixels(own, camera_info):
            return camera_info
        pair = " and ".join(_camera_in_words(info) for info in (own, camera_info))
        doubts.append(f"{topic}: depth and colour are of {pair}; each is mapped by its own")
        return own


def _as_stored(topic: str, info: Any, doubts: list[str]) -> Any:
    """Return the CameraInfo of images as their topic has them, perhaps straightened already."""
    if "/image_rect" not in topic or not np.any(info.d):
        return info
    doubts.append(f"{topic}: taken as straightened already, as its name says")
    return of_rectified(info)


def _camera_in_words(info: Any) -> str:
    bent = "distorted" if np.any(info.d) else "straight"
    return f"{info.width} × {info.height} px with a focal length of {info.k[0]:.1f} px, {bent}"


def _add(stamped: Stamped, stamp_ns: int, log_ns: int, values: Sequence[float] | None) -> None:
    if values is None:
        stamped.skipped += 1
    else:
        stamped.add(stamp_ns, log_ns, values)


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return stamp.sec * NANOSECONDS + stamp.nanosec


def _finite(values: Sequence[float]) -> Sequence[float] | None:
    return values if np.isfinite(values).all() else None


def _place(at: Any, turn: Any) -> Sequence[float] | None:
    """Return position and quat_wxyz (7); None if they are no pose."""
    values = [at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z]
    return _finite(values) if abs(np.linalg.norm(values[3:]) - 1.0) < 0.1 else None


def _joints(message: Any) -> Sequence[float] | None:
    count = len(message.name)
    nothing, parts = np.full(count, np.nan), []
    for values in (message.position, message.velocity, message.effort):
        if len(values) not in (0, count) or not np.isfinite(values).all():
            return None
        parts.append(values if len(values) else nothing)
    return np.concatenate(parts).tolist()


def _xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]
