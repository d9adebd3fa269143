"""Which topics of a robot's log hold what: `topics.yaml`."""

from dataclasses import dataclass, fields
from pathlib import Path

from ..core.errors import FileFormatError, UnknownNameError, brief
from ..core.rollout import EndReason
from ..untrusted.yaml_document import read_yaml

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
# The message types that each topic may have.
KINDS = {
    "odometry": ("nav_msgs/msg/Odometry",),
    "color": _IMAGES,
    "depth": _IMAGES,
    "camera_info": ("sensor_msgs/msg/CameraInfo",),
    "joints": ("sensor_msgs/msg/JointState",),
    "command": ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"),
    "imu": ("sensor_msgs/msg/Imu",),
    "instruction": ("std_msgs/msg/String",),
}


@dataclass(frozen=True)
class TopicMap:
    """Topics, frames and limits; the defaults are those of the bags that vlnpe writes.

    Attributes:
        odometry: Of `base_frame`.
        color, depth: Depth is aligned to colour.
        camera_info: Of both, unless depth has its own.
        depth_info: Depth's own CameraInfo; empty for `camera_info` in the folder of its images, as
            image transports name it, if the bag has that. That of colour says that it is the same.
        joints, command, imu, instruction: An empty name leaves out what a bag has.
        base_frame: Frame of the robot's base.
        end_reason: How the episodes ended, which no topic says.
        max_gap_s: Longest time [s] without a message of any topic but commands and instructions, or
            without a transform to the camera that moves; a longer one ends an episode.
        min_episode_s: Shortest episode [s].
    """

    odometry: str = "/odom"
    color: str = "/camera/color/image_raw/compressed"
    depth: str = "/camera/depth/image_raw"
    camera_info: str = "/camera/color/camera_info"
    depth_info: str = ""
    joints: str = "/joint_states"
    command: str = "/cmd_vel"
    imu: str = "/imu"
    instruction: str = "/instruction"
    base_frame: str = "base_link"
    end_reason: str = EndReason.SUCCESS.value
    max_gap_s: float = 0.5
    min_episode_s: float = 1.0

    @property
    def depth_info_topic(self) -> str:
        """Topic of depth's own CameraInfo: as given, or in the folder of its images, if any."""
        image = self.depth.removesuffix("/compressed").removesuffix("/compressedDepth")
        folder = image.rpartition("/")[0]
        return self.depth_info or (f"{folder}/camera_info" if folder else "")


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
