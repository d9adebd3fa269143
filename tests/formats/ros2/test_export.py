"""Bags of ROS 2: what readers other than the writer find in them."""

import shutil
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

from tests.formats.mcap.test_episode import small_links, small_map, write_frame_folder
from tests.support.lerobot_data import write_unit
from tests.support.rollouts import make_frames, make_rollout
from vlnpe.formats.convert.episodes import unit_from_mcap
from vlnpe.formats.convert.unit_ros2 import ros2_from_unit
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.formats.mcap.episode import write_episode_mcap
from vlnpe.formats.mcap.robot_links import robot_topics
from vlnpe.formats.mcap.shown import map_topic
from vlnpe.formats.video.mp4 import iterate_rgb_video
from vlnpe.pipeline import cli

URDF = "<robot name='made up'><link name='base_link'/></robot>"
KINDS = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/odom": "nav_msgs/msg/Odometry",
    "/cmd_vel": "geometry_msgs/msg/Twist",
    "/camera/color/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "/camera/color/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/depth/image_raw": "sensor_msgs/msg/Image",
    "/camera/depth/camera_info": "sensor_msgs/msg/CameraInfo",
    "/imu": "sensor_msgs/msg/Imu",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/robot_description": "std_msgs/msg/String",
    "/plan": "nav_msgs/msg/Path",
    "/goal_pose": "geometry_msgs/msg/PoseStamped",
    "/instruction": "std_msgs/msg/String",
    "/map": "nav_msgs/msg/OccupancyGrid",
}
Topics = dict[str, list[tuple[int, Any]]]


def read_bag(folder: Path) -> Topics:
    """Return (log time [ns], message) by topic, read by MCAP's own ROS 2 decoder."""
    topics: Topics = defaultdict(list)
    with (folder / f"{folder.name}.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None and schema.encoding == "ros2msg"
            assert channel.message_encoding == "cdr" and KINDS[channel.topic] == schema.name
            topics[channel.topic].append((message.log_time, decoded))
    return topics


def matrix(place: Any) -> np.ndarray:
    """Return the 4 × 4 matrix of a Transform or Pose."""
    at, turn = (
        (place.translation, place.rotation)
        if hasattr(place, "translation")
        else (place.position, place.orientation)
    )
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    result[:3, 3] = at.x, at.y, at.z
    return result


def world(position: np.ndarray, quat_wxyz: np.ndarray) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()
    result[:3, 3] = position
    return result


def transforms(topics: Topics, topic: str, child: str) -> dict[int, tuple[str, np.ndarray]]:
    """Return parent and pose by stamp [ns] of a frame."""
    return {
        stamp(part): (part.header.frame_id, matrix(part.transform))
        for _, message in topics[topic]
        for part in message.transforms
        if part.child_frame_id == child
    }


def stamp(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Rollout, Path]:
    root = tmp_path_factory.mktemp("ros2")
    rollout = make_rollout(3.0, 2)
    write_frame_folder(root / "frames", rollout)
    shown = (map_topic((0.0, small_map())), *robot_topics(small_links(rollout)))
    write_episode_mcap(root / "ep.mcap", rollout, root / "frames", shown=shown)
    unit_from_mcap(root / "ep.mcap", root / "unit")
    ros2_from_unit(root / "unit", root / "walk", URDF)
    return root / "walk", rollout, root / "unit"


def test_every_topic_is_there_once_at_its_rate(written: tuple[Path, Rollout, Path]) -> None:
    folder, rollout, _ = written
    topics, samples, frames = read_bag(folder), len(rollout.time_s), 13
    once = {"/tf_static", "/robot_description", "/plan", "/goal_pose", "/instruction", "/map"}
    assert set(topics) == set(KINDS)
    for topic, messages in topics.items():
        camera = topic.startswith("/camera")
        both = samples + frames if topic == "/tf" else samples
        assert len(messages) == (1 if topic in once else frames if camera else both), topic
        times = [at for at, _ in messages]
        assert times == sorted(times) and times[0] == 10**9  # tf2 takes stamp 0 for "latest"
        for at, message in messages:
            if hasattr(message, "header"):
                assert stamp(message) == at
    with Reader(folder) as reader:  # of metadata.yaml
        assert {c.topic: c.msgcount for c in reader.connections} == {
            topic: len(messages) for topic, messages in topics.items()
        }
        durable = {
            c.topic
            for c in reader.connections
            if isinstance(c.ext, ConnectionExtRosbag2)
            and c.ext.offered_qos_profiles[0].durability.value == 1
        }
    assert durable == once
    information = yaml.safe_load((folder / "metadata.yaml").read_text())
    information = information["rosbag2_bagfile_information"]
    assert information["storage_identifier"] == "mcap"
    assert information["relative_file_paths"] == ["walk.mcap"]


def test_frames_lead_from_the_map_to_the_pixels(written: tuple[Path, Rollout, Path]) -> None:
    folder, rollout, _ = written
    topics, seen = read_bag(folder), make_frames(rollout, 4)
    (_, (parent, odom)) = transforms(topics, "/tf_static", "odom").popitem()
    (_, (camera, optical)) = transforms(
        topics, "/tf_static", "camera_color_optical_frame"
    ).popitem()
    assert (parent, camera) == ("map", "camera_link")
    # REP 103: the optical frame's z is the camera's x, its x is right and its y is down.
    np.testing.assert_allclose(optical[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    bases = transforms(topics, "/tf", "base_link")
    for i, (at, (frame, base)) in enumerate(bases.items()):
        expected = world(rollout.position_world_m[i], rollout.quat_wxyz[i])
        assert frame == "odom" and at == 10**9 + 10**7 * i
        np.testing.assert_allclose(odom @ base, expected, atol=1e-9)
    cameras = transforms(topics, "/tf", "camera_link")
    for k, (at, (frame, place)) in enumerate(cameras.items()):
        expected = world(seen["camera_position_world_m"][k], seen["camera_quat_wxyz"][k])
        assert frame == "base_link"
        np.testing.assert_allclose(odom @ bases[at][1] @ place @ optical, expected, atol=1e-9)


def test_motion_has_ros_units_and_frames(written: tuple[Path, Rollout, Path]) -> None:
    folder, rollout, _ = written
    topics = read_bag(folder)
    bases = transforms(topics, "/tf", "base_link")
    for i, (at, odometry) in enumerate(topics["/odom"]):
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        np.testing.assert_allclose(matrix(odometry.pose.pose), bases[at][1], atol=1e-12)
        linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
        np.testing.assert_array_equal(
            [linear.x, linear.y, linear.z], rollout.linear_velocity_base_m_s[i]
        )
        np.testing.assert_array_equal(
            [angular.x, angular.y, angular.z], rollout.angular_velocity_base_rad_s[i]
        )
        joints = topics["/joint_states"][i][1]
        assert tuple(joints.name) == rollout.joint_names
        np.testing.assert_array_equal(joints.position, rollout.joint_position_rad[i])
        np.testing.assert_array_equal(joints.velocity, rollout.joint_velocity_rad_s[i])
        np.testing.assert_array_equal(joints.effort, rollout.joint_torque_nm[i])
        command = topics["/cmd_vel"][i][1]
        np.testing.assert_array_equal(
            [command.linear.x, command.linear.y, command.angular.z], rollout.command[i]
        )
        imu = topics["/imu"][i][1]
        force, rate = imu.linear_acceleration, imu.angular_velocity
        values = [force.x, force.y, force.z, rate.x, rate.y, rate.z]
        np.testing.assert_array_equal(values, rollout.imu[i])
        assert imu.orientation_covariance[0] == -1  # it measures none


def test_images_are_those_of_the_frames(written: tuple[Path, Rollout, Path]) -> None:
    folder, _, unit = written
    topics = read_bag(folder)
    seen = list(iterate_rgb_video(unit / "observation.images.rgb.mp4"))
    depths = list(read_episode_unit(unit).depth_m(range(len(seen))))
    for k, (_, depth) in enumerate(topics["/camera/depth/image_raw"]):
        color = topics["/camera/color/image_raw/compressed"][k][1]
        assert color.format == "jpeg"
        image = cv2.imdecode(np.frombuffer(color.data, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        difference = np.abs(image[..., ::-1].astype(int) - seen[k])
        assert difference.mean() < 2
        assert (depth.encoding, depth.step, depth.is_bigendian) == ("16UC1", 2 * 96, 0)
        millimetres = np.frombuffer(depth.data, "<u2").reshape(depth.height, depth.width)
        np.testing.assert_allclose(millimetres / 1000, depths[k], atol=0.000501)
        for topic in ("/camera/color/camera_info", "/camera/depth/camera_info"):
            info = topics[topic][k][1]
            assert (info.width, info.height, info.distortion_model) == (96, 64, "plumb_bob")
            np.testing.assert_allclose(
                np.reshape(info.k, (3, 3)), [[48, 0, 47.5], [0, 48, 31.5], [0, 0, 1]]
            )
            assert info.header.frame_id == color.header.frame_id == "camera_color_optical_frame"


def test_the_task_and_the_map(written: tuple[Path, Rollout, Path]) -> None:
    folder, rollout, _ = written
    topics, episode = read_bag(folder), rollout.episode
    assert topics["/instruction"][0][1].data == episode.instruction
    assert topics["/robot_description"][0][1].data == URDF
    plan = topics["/plan"][0][1]
    points = [matrix(p.pose)[:3, 3] for p in plan.poses]
    np.testing.assert_array_equal(points, episode.reference_path_world_m)
    goal = topics["/goal_pose"][0][1]
    assert plan.header.frame_id == goal.header.frame_id == "map"
    np.testing.assert_array_equal(matrix(goal.pose)[:3, 3], episode.goal_position_world_m)
    grid = topics["/map"][0][1]
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 0.5)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (1, 2)
    assert list(grid.data) == [-1, 0, 0, 0, 0, 100]
    # As Nav2's map server reads it: the first row of the image is the farthest.
    facts = yaml.safe_load((folder / "map.yaml").read_text())
    pixels = cv2.imread(str(folder / facts["image"]), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    occupied = (255 - np.flipud(pixels).astype(float)) / 255
    cells = np.where(occupied > facts["occupied_thresh"], 100, -1)
    cells[occupied < facts["free_thresh"]] = 0
    assert facts["origin"] == [1.0, 2.0, 0.0] and cells.ravel().tolist() == list(grid.data)


def test_another_storey_has_its_own_map_from_when_the_robot_is_on_it(tmp_path: Path) -> None:
    lower = small_map()
    upper = replace(lower, floor_z_m=lower.floor_z_m + 3.0, traversable=~lower.traversable)
    rollout = make_rollout(3.0, 2)
    write_frame_folder(tmp_path / "frames", rollout)
    shown = (map_topic((0.0, lower), (1.5, upper), (2.5, lower)),)
    write_episode_mcap(tmp_path / "ep.mcap", rollout, tmp_path / "frames", shown=shown)
    unit_from_mcap(tmp_path / "ep.mcap", tmp_path / "unit")
    ros2_from_unit(tmp_path / "unit", tmp_path / "walk")
    maps = read_bag(tmp_path / "walk")["/map"]
    begin = int(rollout.time_s[0] * 1e9) + 10**9
    assert [at - begin for at, _ in maps] == [0, 1_500_000_000, 2_500_000_000]
    heights = [grid.info.origin.position.z for _, grid in maps]
    np.testing.assert_allclose(np.diff(heights), [3.0, -3.0], atol=1e-6)
    assert list(maps[0][1].data) == list(maps[2][1].data) != list(maps[1][1].data)
    names = sorted(path.name for path in (tmp_path / "walk").glob("map*"))
    assert names == ["map.pgm", "map.yaml", "map_2.pgm", "map_2.yaml"]
    assert yaml.safe_load((tmp_path / "walk" / "map_2.yaml").read_text())["image"] == "map_2.pgm"


def test_a_dataset_alone_gives_bags_at_frame_rate_without_what_it_lacks(tmp_path: Path) -> None:
    rollout = make_rollout(2.0)
    ros2_from_unit(write_unit(tmp_path, rollout), tmp_path / "walk")
    topics = read_bag(tmp_path / "walk")
    assert set(KINDS) - set(topics) == {"/map", "/robot_description"}
    assert len(topics["/odom"]) == 9
    assert not len(topics["/joint_states"][0][1].effort)  # datasets have no torques
    bases = transforms(topics, "/tf", "base_link")
    (_, (_, odom)) = transforms(topics, "/tf_static", "odom").popitem()
    for k, (_, base) in enumerate(bases.values()):
        expected = world(rollout.position_world_m[25 * k], rollout.quat_wxyz[25 * k])
        np.testing.assert_allclose(odom @ base, expected, atol=1e-6)


def test_a_damaged_video_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    unit = write_unit(tmp_path, make_rollout(2.0))
    video = unit / "observation.images.rgb.mp4"
    data = video.read_bytes()
    video.unlink()
    video.write_bytes(data[: len(data) // 2])
    with pytest.raises(FileFormatError, match=r"observation\.images\.rgb\.mp4"):
        ros2_from_unit(unit, tmp_path / "out" / "walk")
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.usefixtures("inline")
def test_the_command_writes_a_bag_per_walk(
    written: tuple[Path, Rollout, Path], tmp_path: Path
) -> None:
    recorded = tmp_path / "walks"
    recorded.mkdir()
    shutil.copyfile(written[0].parent / "ep.mcap", recorded / "ep.mcap")
    command = ["convert", str(recorded), "--to", "ros2", "--out", str(tmp_path / "out")]
    assert cli.main(command) == 0
    topics = read_bag(tmp_path / "out" / "ros2" / "walks" / "ep")
    assert 'name="FL_hip_joint"' in topics["/robot_description"][0][1].data
