"""An episode with its rendered frames as a bag of ROS 2, in the frames of REP 103 and 105.

map -> odom -> base_link -> camera_link -> camera_color_optical_frame. `map` is the scene's world,
and `odom` the start frame that a dataset's states are in. Odometry and transforms are exact.
"""

import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.atomic import atomic_folder
from ..core.frames import quat_multiply, yaw_to_quat
from ..core.rollout import Rollout
from ..mcap.camera import camera_in_base
from ..rendered.folder import FrameFolder
from ..rendered.table import StartFrame
from ..video.depth_codes import codes_to_millimetres
from ..video.mp4 import iterate_depth_codes, iterate_rgb_video
from .bag import Bag, Topic, Write, open_bag
from .maps import WalkMap, write_maps
from .messages import header, make, nanoseconds, pose, quaternion, transforms, twist, vector

MAP, ODOM, BASE = "map", "odom", "base_link"
CAMERA, OPTICAL = "camera_link", "camera_color_optical_frame"
# The optical frame (x right, y down, z forward) in the camera's (x forward, y left, z up).
OPTICAL_IN_CAMERA = np.array([0.5, -0.5, 0.5, -0.5])
# Full chroma: videos have a quarter of it, and a second thinning costs as much as the codec did.
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]
_JPEG += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
_ZERO = np.zeros(3)
_UNKNOWN = np.zeros(36)


def write_bag(
    out: Path,
    rollout: Rollout,
    view: FrameFolder,
    *,
    maps: Sequence[WalkMap] = (),
    urdf: str | None = None,
) -> None:
    """Write a folder with a bag and its maps, replaced as a whole; what is unknown has no topic.

    Args:
        maps: In order.
        urdf: The robot's model, whose root link is `base_link`.

    Raises:
        FileFormatError: If a video is damaged.
        ValueError: If its depth does not fit into 16 bits of millimetres.
    """
    with atomic_folder(out) as temporary:
        folder = temporary / out.name  # the bag's files are named like it
        with open_bag(folder) as bag:
            moved = bag.topic("/tf", "tf2_msgs/TFMessage")
            streams = (
                _latched(bag, rollout, urdf),
                _maps(bag, maps, rollout.time_s[0]),
                _motion(bag, rollout, moved),
                _images(bag, rollout, view, moved),
            )
            for _, write in heapq.merge(*streams, key=lambda item: item[0]):
                write()
        write_maps(folder, maps)
        for entry in folder.iterdir():
            entry.rename(temporary / entry.name)
        folder.rmdir()


def _latched(bag: Bag, rollout: Rollout, urdf: str | None) -> Iterator[Write]:
    """Yield what holds for the whole walk."""
    at, start, episode = nanoseconds(rollout.time_s[0]), StartFrame.of(rollout), rollout.episode

    def once(topic: str, kind: str, message: Any) -> Write:
        return bag.topic(topic, kind, latched=True)(at, message)

    odom = MAP, ODOM, start.origin_world_m, yaw_to_quat(start.yaw_rad)
    optical = CAMERA, OPTICAL, _ZERO, OPTICAL_IN_CAMERA
    yield once("/tf_static", "tf2_msgs/TFMessage", transforms(at, odom, optical))
    if urdf is not None:
        yield once("/robot_description", "std_msgs/String", make("std_msgs/String", urdf))
    if episode.instruction:
        text = make("std_msgs/String", episode.instruction)
        yield once("/instruction", "std_msgs/String", text)
    path = episode.reference_path_world_m
    if len(path):
        stamped = [
            make("geometry_msgs/PoseStamped", header(at, MAP), pose(point, yaw_to_quat(yaw)))
            for point, yaw in zip(path, _headings(path), strict=True)
        ]
        plan = make("nav_msgs/Path", header(at, MAP), stamped)
        yield once("/plan", "nav_msgs/Path", plan)
    goal = episode.goal_position_world_m
    if np.isfinite(goal).all():
        yaw = _headings(path)[-1] if len(path) else 0.0
        place = make("geometry_msgs/PoseStamped", header(at, MAP), pose(goal, yaw_to_quat(yaw)))
        yield once("/goal_pose", "geometry_msgs/PoseStamped", place)


def _maps(bag: Bag, maps: Sequence[WalkMap], start_s: float) -> Iterator[Write]:
    """Yield each map when it begins to hold, the first with the first sample."""
    if not maps:
        return
    topic = bag.topic("/map", "nav_msgs/OccupancyGrid", latched=True)
    for entry in maps:
        at = nanoseconds(max(entry.from_s, start_s))
        yield topic(at, entry.message(at, MAP))


def _headings(path_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the yaw (P,) [rad] along a path (P, 3); the last point's is that before it."""
    if len(path_m) < 2:
        return np.zeros(len(path_m))
    steps = np.diff(path_m, axis=0)
    yaw = np.arctan2(steps[:, 1], steps[:, 0])
    return np.append(yaw, yaw[-1])


def _motion(bag: Bag, rollout: Rollout, moved: Topic) -> Iterator[Write]:
    """Yield transform, odometry, joints, command and inertial sensor of every sample."""
    start = StartFrame.of(rollout)
    positions = start.position(rollout.position_world_m)
    rotations = start.orientation(rollout.quat_wxyz)
    odometry = bag.topic("/odom", "nav_msgs/Odometry")
    joints = bag.topic("/joint_states", "sensor_msgs/JointState") if rollout.joint_names else None
    known = np.asarray(np.isfinite(rollout.command).all(axis=1))
    command = bag.topic("/cmd_vel", "geometry_msgs/Twist") if known.any() else None
    sensed = np.asarray(np.isfinite(rollout.imu).all(axis=1))
    imu = bag.topic("/imu", "sensor_msgs/Imu") if sensed.any() else None
    for i, time_s in enumerate(rollout.time_s):
        at = nanoseconds(time_s)
        position, rotation = positions[i], rotations[i]
        yield moved(at, transforms(at, (ODOM, BASE, position, rotation)))
        speed = rollout.linear_velocity_base_m_s[i], rollout.angular_velocity_base_rad_s[i]
        placed = make("geometry_msgs/PoseWithCovariance", pose(position, rotation), _UNKNOWN)
        moving = make("geometry_msgs/TwistWithCovariance", twist(*speed), _UNKNOWN)
        yield odometry(at, make("nav_msgs/Odometry", header(at, ODOM), BASE, placed, moving))
        if joints is not None:
            states = (
                rollout.joint_position_rad[i],
                rollout.joint_velocity_rad_s[i],
                rollout.joint_torque_nm[i],
            )
            # What is not known has no entries at all, as JointState demands.
            values = [np.array(v if np.isfinite(v).all() else (), np.float64) for v in states]
            names = list(rollout.joint_names)
            yield joints(at, make("sensor_msgs/JointState", header(at, ""), names, *values))
        if command is not None and known[i]:
            vx, vy, yaw_rate = rollout.command[i]
            yield command(at, twist(np.array([vx, vy, 0.0]), np.array([0.0, 0.0, yaw_rate])))
        if imu is not None and sensed[i]:
            yield imu(at, _imu(at, rollout.imu[i]))


def _imu(at: int, values: NDArray[np.float64]) -> Any:
    nothing = np.zeros(9)
    unmeasured = np.append(-1.0, np.zeros(8))
    return make(
        "sensor_msgs/Imu",
        header(at, BASE),
        quaternion(np.array([1.0, 0.0, 0.0, 0.0])),
        unmeasured,
        vector(values[3:]),
        nothing,
        vector(values[:3]),
        nothing,
    )


def _images(bag: Bag, rollout: Rollout, view: FrameFolder, moved: Topic) -> Iterator[Write]:
    """Yield the camera's place, calibration, colour and depth of each frame."""
    color = bag.topic("/camera/color/image_raw/compressed", "sensor_msgs/CompressedImage")
    color_info = bag.topic("/camera/color/camera_info", "sensor_msgs/CameraInfo")
    depth = bag.topic("/camera/depth/image_raw", "sensor_msgs/Image")
    depth_info = bag.topic("/camera/depth/camera_info", "sensor_msgs/CameraInfo")
    position, optical = camera_in_base(rollout, view)
    turned = quat_multiply(optical, OPTICAL_IN_CAMERA * [1, -1, -1, -1])
    pictures = zip(
        rollout.time_s[view.arrays["sample_index"]],
        iterate_rgb_video(view.rgb_video),
        iterate_depth_codes(view.depth_video, view.depth_range),
        strict=True,
    )
    for i, (time_s, image, codes) in enumerate(pictures):
        at = nanoseconds(time_s)
        head, info = header(at, OPTICAL), _camera_info(at, view)
        yield moved(at, transforms(at, (BASE, CAMERA, position[i], turned[i])))
        yield color_info(at, info)
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        data = cv2.imencode(".jpg", bgr, _JPEG)[1].ravel()
        yield color(at, make("sensor_msgs/CompressedImage", head, "jpeg", data))
        yield depth_info(at, info)
        millimetres = codes_to_millimetres(codes, view.depth_range).astype("<u2")
        rows, columns = millimetres.shape
        pixels = millimetres.reshape(-1).view(np.uint8)
        shape = rows, columns, "16UC1", 0, 2 * columns
        yield depth(at, make("sensor_msgs/Image", head, *shape, pixels))


def _camera_info(at: int, view: FrameFolder) -> Any:
    camera, k = view.camera, view.camera.intrinsics
    projection = np.hstack([k, np.zeros((3, 1))])
    return make(
        "sensor_msgs/CameraInfo",
        header=header(at, OPTICAL),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=projection.ravel(),
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/RegionOfInterest", 0, 0, 0, 0, False),
    )
