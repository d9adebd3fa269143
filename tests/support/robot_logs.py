"""Logs of a robot, as bags that `rosbags` writes."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vlnpe.pipeline import cli

# Log time [s], topic, type and content.
Logged = tuple[float, str, str, Any]

COLOR, DEPTH = "/camera/camera/color/image_raw", "/camera/camera/aligned_depth_to_color/image_raw"
INFO, ODOM, JOINTS = "/camera/camera/color/camera_info", "/utlidar/robot_odom", "/lowstate/joints"
Change = Callable[[list[Logged]], list[Logged]]
STORE = get_typestore(Stores.ROS2_HUMBLE)
EPOCH_S = 1_790_000_000
TOPICS = """
odometry: /utlidar/robot_odom
color: /camera/camera/color/image_raw
depth: /camera/camera/aligned_depth_to_color/image_raw
camera_info: /camera/camera/color/camera_info
joints: /lowstate/joints
command: /api/cmd_vel
"""
WIDTH, HEIGHT, FOCAL_PX = 64, 48, 40.0


def make(kind: str, *values: Any, **fields: Any) -> Any:
    return STORE.types[kind.replace("/", "/msg/")](*values, **fields)


def position(time_s: float) -> np.ndarray:
    return np.array([0.5 * time_s, 0.1 * np.sin(time_s), 0.3])


def log_messages(
    *,
    seconds: float = 6.0,
    hole: tuple[float, float] | None = None,
    behind_s: float = 0.0,
    depth: str = "16UC1",
) -> list[Logged]:
    """Return odometry at 37 Hz, colour at 15 Hz, depth at 11 Hz, joints at 50 Hz, commands at 7 Hz.

    Args:
        hole: Seconds without colour.
        behind_s: How far the camera's clock is behind the recorder's.
    """

    def header(time_s: float, frame: str, late: float = 0.0) -> Any:
        at = round((EPOCH_S + time_s - late) * 1e9)
        return make("std_msgs/Header", make("builtin_interfaces/Time", *divmod(at, 10**9)), frame)

    messages: list[Logged] = []
    still = make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0)
    for time_s in np.arange(0, seconds, 1 / 37).tolist():
        pose = make(
            "geometry_msgs/Pose", make("geometry_msgs/Point", *position(time_s).tolist()), still
        )
        zero = make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        speed = make("geometry_msgs/Vector3", 0.5, 0.0, 0.0)
        message = make(
            "nav_msgs/Odometry",
            header(time_s, "odom"),
            "base_link",
            make("geometry_msgs/PoseWithCovariance", pose, np.zeros(36)),
            make(
                "geometry_msgs/TwistWithCovariance",
                make("geometry_msgs/Twist", speed, zero),
                np.zeros(36),
            ),
        )
        messages.append((time_s, "/utlidar/robot_odom", "nav_msgs/Odometry", message))
    k = np.array([FOCAL_PX, 0, (WIDTH - 1) / 2, 0, FOCAL_PX, (HEIGHT - 1) / 2, 0, 0, 1])
    info = make(
        "sensor_msgs/CameraInfo",
        header=header(0, "optical", behind_s),
        height=HEIGHT,
        width=WIDTH,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=k,
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/RegionOfInterest", 0, 0, 0, 0, False),
    )
    messages.append((0.0, "/camera/camera/color/camera_info", "sensor_msgs/CameraInfo", info))
    for time_s in np.arange(0, seconds, 1 / 15).tolist():
        if hole is None or not hole[0] < time_s < hole[1]:
            grey = np.full((HEIGHT, WIDTH, 3), round(40 * time_s) % 256, np.uint8)
            size = HEIGHT, WIDTH, "bgr8", 0, 3 * WIDTH
            image = make(
                "sensor_msgs/Image", header(time_s, "optical", behind_s), *size, grey.ravel()
            )
            messages.append((time_s, "/camera/camera/color/image_raw", "sensor_msgs/Image", image))
    topic = "/camera/camera/aligned_depth_to_color/image_raw"
    for time_s in np.arange(0, seconds, 1 / 11).tolist() if depth else ():
        metres, head = 1 + time_s / 4, header(time_s, "optical", behind_s)
        if depth == "compressedDepth":
            png = cv2.imencode(".png", np.full((HEIGHT, WIDTH), round(1000 * metres), np.uint16))[1]
            data = np.concatenate([np.zeros(12, np.uint8), png.ravel()])
            kind = "sensor_msgs/CompressedImage"
            image = make(kind, head, "16UC1; compressedDepth png", data)
        else:
            whole = depth == "16UC1"
            value = round(1000 * metres) if whole else metres
            pixels = np.full((HEIGHT, WIDTH), value, np.uint16 if whole else np.float32)
            kind = "sensor_msgs/Image"
            size = HEIGHT, WIDTH, depth, 0, pixels.itemsize * WIDTH
            image = make(kind, head, *size, pixels.reshape(-1).view(np.uint8))
        messages.append((time_s, topic, kind, image))
    for time_s in np.arange(0, seconds, 1 / 50).tolist():
        joints = np.array([time_s, -time_s])
        message = make(
            "sensor_msgs/JointState",
            header(time_s, ""),
            ["a", "b"],
            joints,
            joints * 0 + 1,
            np.empty(0),
        )
        messages.append((time_s, "/lowstate/joints", "sensor_msgs/JointState", message))
    for number, time_s in enumerate(np.arange(0, seconds, 1 / 7).tolist()):
        linear = make("geometry_msgs/Vector3", 0.1 * number, 0.0, 0.0)
        zero = make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        message = make("geometry_msgs/Twist", linear, zero)
        messages.append((time_s, "/api/cmd_vel", "geometry_msgs/Twist", message))
    mount = make(
        "geometry_msgs/TransformStamped",
        header(0, "base_link"),
        "optical",
        make(
            "geometry_msgs/Transform",
            make("geometry_msgs/Vector3", 0.3, 0.0, 0.1),
            make("geometry_msgs/Quaternion", -0.5, 0.5, -0.5, 0.5),
        ),
    )
    static = make("tf2_msgs/TFMessage", [mount])
    messages.append((0.0, "/tf_static", "tf2_msgs/TFMessage", static))
    return messages


def write_messages(
    path: Path, messages: list[Logged], storage: StoragePlugin = StoragePlugin.MCAP
) -> None:
    """Write a bag."""
    with Writer(path, version=8, storage_plugin=storage) as writer:
        connections = {}
        for time_s, topic, kind, message in sorted(messages, key=lambda m: m[0]):
            full = kind.replace("/", "/msg/")
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, full, typestore=STORE)
            at = round((EPOCH_S + time_s) * 1e9)
            writer.write(connections[topic], at, STORE.serialize_cdr(message, full))


def write_log(path: Path, storage: StoragePlugin = StoragePlugin.MCAP, **how: Any) -> None:
    """Write the bag of `log_messages`."""
    write_messages(path, log_messages(**how), storage)


def topic_map(root: Path, text: str = TOPICS) -> Path:
    path = root / "topics.yaml"
    path.write_text(text)
    return path


def convert_log(bag: Path, *options: str) -> tuple[int, Path]:
    """Convert a bag; return the exit status and the output folder."""
    out = bag.parent / "out"
    command = ["convert", str(bag), "--from", "ros2", "--robot", "dog", "--base-height-m", "0.3"]
    command += ["--map", str(topic_map(bag.parent)), "--out", str(out), *options]
    return cli.main(command), out


def each(topic: str, change: Callable[[Any, int], Any]) -> Change:
    """Change each message of a topic, given with its number."""

    def changed(log: list[Logged]) -> list[Logged]:
        own = (message for _, name, _, message in log if name == topic)
        for number, message in enumerate(own):
            change(message, number)
        return log

    return changed


def without(topic: str, after_s: float = -1.0) -> Change:
    return lambda log: [m for m in log if m[1] != topic or m[0] <= after_s]


def shifted(message: Any, seconds: float) -> None:
    stamp = message.header.stamp
    at = stamp.sec * 10**9 + stamp.nanosec + round(seconds * 1e9)
    stamp.sec, stamp.nanosec = divmod(at, 10**9)


def moving_mount(log: list[Logged]) -> list[Logged]:
    """Tell the camera's place again and again, as of a head that may turn."""
    (mounted,) = (m for _, n, _, m in log if n == "/tf_static")
    moving: list[Logged] = []
    for time_s in np.arange(0, max(m[0] for m in log), 0.02).tolist():
        message = copy.deepcopy(mounted)
        shifted(message.transforms[0], time_s)
        moving.append((time_s, "/tf", "tf2_msgs/TFMessage", message))
    return [*(m for m in log if m[1] != "/tf_static"), *moving]
