"""The topics of a robot that every MCAP file has, in Foxglove's own schemas."""

import heapq
from collections.abc import Callable, Iterator
from typing import Any

import foxglove
from foxglove.channels import (
    FrameTransformsChannel,
    JointStatesChannel,
    LogChannel,
    PoseInFrameChannel,
)
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    JointState,
    JointStates,
    Log,
    LogLevel,
    Pose,
    PoseInFrame,
    Quaternion,
    Vector3,
)
from numpy.typing import NDArray

from ..core.rollout import EndReason, Rollout
from .recording import Recording, nanoseconds, timestamp
from .state import SCHEMA_NAME, encode_states, state_schema

WORLD_FRAME, BASE_FRAME, CAMERA_FRAME = "world", "base", "camera_optical"
STATE_TOPIC = "/state"
TRANSFORM_TOPIC = "/tf"
POSE_TOPIC = "/base/pose"
JOINT_TOPIC = "/joint_states"
LOG_TOPIC = "/events"

# A message to write: its log time [ns], and how.
Write = tuple[int, Callable[[], None]]


def logged(channel: Any, time_s: float, message: Any) -> Write:
    """Return how to log a message on a channel at a simulation time [s]."""
    at = nanoseconds(time_s)
    return at, lambda: channel.log(message, log_time=at)


def vector(values: NDArray) -> Vector3:
    """Convert an array (3,) to a message."""
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def quaternion(quat_wxyz: NDArray) -> Quaternion:
    """Convert a quaternion wxyz to a message."""
    w, x, y, z = quat_wxyz.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def pose(position_m: NDArray, quat_wxyz: NDArray) -> Pose:
    """Convert a position (3,) [m] and a quaternion to a message."""
    return Pose(position=vector(position_m), orientation=quaternion(quat_wxyz))


def transform(
    parent: str, child: str, time_s: float, position_m: NDArray, quat_wxyz: NDArray
) -> FrameTransform:
    """Return where a child frame lies in its parent at a time: (3,) [m] and quaternion."""
    return FrameTransform(
        timestamp=timestamp(time_s),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=vector(position_m),
        rotation=quaternion(quat_wxyz),
    )


def write_in_order(*streams: Iterator[Write]) -> None:
    """Write messages in order of time; of those at one time, earlier streams first.

    Each stream is in order itself. Only the next message of each is held.
    """
    for _, write in heapq.merge(*streams, key=lambda item: item[0]):
        write()


def state_messages(recording: Recording, rollout: Rollout) -> Iterator[Write]:
    """Yield the exact state of every sample."""
    channel = foxglove.Channel(
        STATE_TOPIC,
        schema=foxglove.Schema(name=SCHEMA_NAME, encoding="protobuf", data=state_schema()),
        message_encoding="protobuf",
        context=recording.context,
    )
    for time_s, data in zip(rollout.time_s, encode_states(rollout), strict=True):
        yield logged(channel, time_s, data)


def motion_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Yield transform world → base, base pose and joint states of every `every`-th sample."""
    transforms = FrameTransformsChannel(TRANSFORM_TOPIC, context=recording.context)
    poses = PoseInFrameChannel(POSE_TOPIC, context=recording.context)
    joints = JointStatesChannel(JOINT_TOPIC, context=recording.context)
    for i in range(0, len(rollout.time_s), every):
        time_s, stamp = rollout.time_s[i], timestamp(rollout.time_s[i])
        place = rollout.position_world_m[i], rollout.quat_wxyz[i]
        base = transform(WORLD_FRAME, BASE_FRAME, time_s, *place)
        yield logged(transforms, time_s, FrameTransforms(transforms=[base]))
        message = PoseInFrame(timestamp=stamp, frame_id=WORLD_FRAME, pose=pose(*place))
        yield logged(poses, time_s, message)
        states = [
            JointState(name=name, position=q, velocity=v, effort=t)
            for name, q, v, t in zip(
                rollout.joint_names,
                rollout.joint_position_rad[i].tolist(),
                rollout.joint_velocity_rad_s[i].tolist(),
                rollout.joint_torque_nm[i].tolist(),
                strict=True,
            )
        ]
        yield logged(joints, time_s, JointStates(timestamp=stamp, joints=states))


def event_messages(recording: Recording, rollout: Rollout) -> Iterator[Write]:
    """Yield events as log messages; the last one says how the episode ended."""
    channel = LogChannel(LOG_TOPIC, context=recording.context)

    def log(time_s: float, level: LogLevel, text: str, name: str) -> Write:
        message = Log(timestamp=timestamp(time_s), level=level, message=text, name=name)
        return logged(channel, time_s, message)

    for event in sorted(rollout.events, key=lambda event: event.time_s):
        text = f"{event.kind}: {event.detail}" if event.detail else event.kind
        yield log(event.time_s, LogLevel.Warning, text, event.kind)
    ended = rollout.end_reason
    level = LogLevel.Info if ended is EndReason.SUCCESS else LogLevel.Error
    last = max([rollout.time_s[-1], *(event.time_s for event in rollout.events)])
    yield log(last, level, f"end: {ended.value}", "end")
