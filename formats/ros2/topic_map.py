"""Which topics of a robot's log hold what: `topics.yaml`."""

from dataclasses import dataclass, fields
from pathlib import Path

from ..core.errors import FileFormatError, UnknownNameError, brief
from ..core.rollout import EndReason
from ..untrusted.yaml_document import read_yaml


@dataclass(frozen=True)
class TopicMap:
    """Topics, frames and limits; the defaults are those of the bags that vlnpe writes.

    Attributes:
        odometry: nav_msgs/Odometry.
        color, depth: sensor_msgs/Image or CompressedImage; depth is aligned to colour.
        camera_info: sensor_msgs/CameraInfo of both.
        joints, command, imu, instruction: JointState, Twist or TwistStamped, Imu, String.
        base_frame: Frame of the robot's base.
        end_reason: How the episodes ended, which no topic says.
        max_gap_s: Longest time without odometry, colour or depth [s]; a longer one ends an episode.
        min_episode_s: Shortest episode [s].
    """

    odometry: str = "/odom"
    color: str = "/camera/color/image_raw/compressed"
    depth: str = "/camera/depth/image_raw"
    camera_info: str = "/camera/color/camera_info"
    joints: str = "/joint_states"
    command: str = "/cmd_vel"
    imu: str = "/imu"
    instruction: str = "/instruction"
    base_frame: str = "base_link"
    end_reason: str = EndReason.SUCCESS.value
    max_gap_s: float = 0.5
    min_episode_s: float = 1.0


def read_topic_map(path: Path) -> TopicMap:
    """Read a YAML mapping of fields of `TopicMap`.

    Raises:
        FileFormatError: If it is damaged, or a field or value is unknown.
    """
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise FileFormatError(path, "not a mapping")
    kinds = {field.name: type(field.default) for field in fields(TopicMap)}
    for key, value in values.items():
        if key not in kinds:
            reason = str(UnknownNameError("field", str(key), kinds))
            raise FileFormatError(path, reason)
        kind = kinds[key]
        if kind is float and type(value) is int:
            values[key] = value = float(value)
        if type(value) is not kind or (kind is float and not 0 < value < 3600):
            valid = "a text" if kind is str else "seconds above 0"
            raise FileFormatError(path, f"{key}: {brief(value)}; valid: {valid}")
    result = TopicMap(**values)
    if result.end_reason not in [reason.value for reason in EndReason]:
        valid = ", ".join(EndReason)
        raise FileFormatError(path, f"end_reason: {brief(result.end_reason)}; valid: {valid}")
    return result
