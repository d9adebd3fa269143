"""Logs of robots, as bags that `rosbags` writes: resampled, and nothing invented."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.support.lerobot_data import write_unit
from tests.support.robot_logs import (
    COLOR,
    FOCAL_PX,
    HEIGHT,
    INFO,
    TOPICS,
    WIDTH,
    each,
    log_messages,
    position,
    topic_map,
    write_log,
    write_messages,
)
from tests.support.rollouts import make_rollout
from vlnpe.formats.convert.dataset import open_dataset
from vlnpe.formats.convert.ros2_unit import unit_from_log
from vlnpe.formats.convert.unit_ros2 import ros2_from_unit
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.lerobot import EpisodeUnit, read_episode_unit
from vlnpe.formats.lerobot.episode_columns import camera_of
from vlnpe.formats.lerobot.units.rows import row_arrays
from vlnpe.formats.ros2.calibration import Straightener, ideal_camera
from vlnpe.formats.ros2.pixels import images
from vlnpe.formats.ros2.resample import image_times_ns, rollout_of_span, spans
from vlnpe.formats.ros2.topic_map import TopicMap, read_topic_map
from vlnpe.formats.ros2.tracks import read_tracks
from vlnpe.formats.video.mp4 import iterate_rgb_video
from vlnpe.pipeline import cli


def convert(bag: Path, folder: Path, rate: int = 4, topics: str = TOPICS) -> list[dict[str, Any]]:
    """Return the rows of each episode of a log."""
    topic_names = read_topic_map(topic_map(folder.parent, topics))
    tracks, result = read_tracks(bag, topic_names), []
    for number, span in enumerate(spans(bag, tracks, topic_names)):
        out = folder / f"{number}"
        unit_from_log(
            bag,
            tracks,
            topic_names,
            span,
            out,
            robot="dog",
            joint_names=tracks.joint_names,
            base_height_m=0.3,
            rate=rate,
            split="train",
        )
        unit = read_episode_unit(out)
        depths = list(unit.depth_m(range(unit.length)))
        rows = row_arrays(unit.rows())
        result.append({**rows, "rgb": frames(unit), "depth": depths, "span": span, "unit": unit})
    return result


def frames(unit: EpisodeUnit) -> list[np.ndarray]:
    return list(iterate_rgb_video(unit.video("observation.images.rgb")))


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("depth", ["16UC1", "32FC1", "compressedDepth"])
def test_topics_of_different_rates_meet_at_the_frames(
    tmp_path: Path, depth: str, storage: StoragePlugin
) -> None:
    write_log(tmp_path / "log", depth=depth, storage=storage, behind_s=3600.0)
    (rows,) = convert(tmp_path / "log", tmp_path / "units", 5)
    times = np.arange(len(rows["timestamp"])) / 5
    assert 5.7 < times[-1] < 6.0
    expected = np.stack([position(t) for t in times]) - [0, 0, 0]
    np.testing.assert_allclose(rows["observation.state"][:, :2], expected[:, :2], atol=2e-3)
    np.testing.assert_allclose(rows["observation.state"][:, 2], 0.3, atol=1e-6)
    np.testing.assert_allclose(rows["observation.camera_pose"][:, 2], 0.4, atol=1e-6)
    last_joint = np.minimum(times, 5.98)
    np.testing.assert_allclose(rows["observation.joints"][:, 0], last_joint, atol=1e-6)
    held = 0.1 * np.floor(times * 7 + 1e-9)
    np.testing.assert_allclose(rows["action.velocity"][:, 0], held, atol=1e-6)
    for time_s, image, metres in zip(times, rows["rgb"], rows["depth"], strict=True):
        assert abs(image.mean() - 40 * time_s) < 40 / 30 + 4  # half a frame of 15 Hz; the codec
        assert abs(metres.mean() - 1 - time_s / 4) < 1 / 22 / 4 + 0.004  # half a frame of 11 Hz
    assert "observation.imu" not in rows and "observation.foot_contact" not in rows


def test_gaps_end_episodes(tmp_path: Path) -> None:
    write_log(tmp_path / "log", hole=(2.5, 4.0))
    first, second = convert(tmp_path / "log", tmp_path / "units")
    assert first["span"].stop_s <= 2.5 and second["span"].start_s >= 4.0
    assert {len(rows["rgb"]) for rows in (first, second)} == {10, 8}


def test_the_floor_of_a_log_is_level_where_a_gait_bobs_and_follows_stairs(tmp_path: Path) -> None:
    write_log(tmp_path / "log", seconds=20.0)
    topics = read_topic_map(topic_map(tmp_path))
    tracks = read_tracks(tmp_path / "log", topics)
    time_s = tracks.odometry.time_s
    # It stands for 2 s, walks 2 cm lower, climbs 1.5 m from 8 to 14 s, and walks on.
    climbed_m = np.interp(time_s, [8.0, 14.0], [0.0, 1.5])
    bob_m = 0.025 * np.sin(2 * np.pi * 3.3 * time_s) - 0.02
    tracks.odometry.values[:, 2] += climbed_m + np.where(time_s > 2.0, bob_m, 0.0)
    (span,) = spans(tmp_path, tracks, topics)
    walk = rollout_of_span(
        tracks, topics, span, robot="dog", joint_names=(), base_height_m=0.25, rate=4,
        name="a", scene="b", split="train",
    )  # fmt: skip
    at_s = walk.time_s + span.start_s
    climbed_m = np.interp(at_s, [8.0, 14.0], [0.0, 1.5])
    np.testing.assert_allclose(walk.floor_z_m[at_s < 7.5], 0.05, atol=1e-9)
    np.testing.assert_allclose(walk.floor_z_m, 0.05 + climbed_m, atol=0.08)
    assert np.ptp(walk.floor_z_m[(at_s > 15.0) & (at_s < 19.0)]) < 1e-3
    np.testing.assert_array_equal(walk.episode.start_position_world_m[2], walk.floor_z_m[0])


def test_depth_that_is_missing_is_invalid(tmp_path: Path) -> None:
    write_log(tmp_path / "log", seconds=2.0, depth="")
    (rows,) = convert(tmp_path / "log", tmp_path / "units")
    assert not np.any(rows["depth"])


def test_images_of_one_log_time_are_told_apart_by_their_stamps(tmp_path: Path) -> None:
    """A recorder that was busy writes several at once."""
    log = [
        (np.ceil(2 * t) / 2 if name == COLOR else t, name, kind, message)
        for t, name, kind, message in log_messages(seconds=3.0)
    ]
    write_messages(tmp_path / "log", log)
    topics = read_topic_map(topic_map(tmp_path))
    tracks = read_tracks(tmp_path / "log", topics)
    times_s = tracks.color.time_s
    assert len(times_s) == 45
    wanted = image_times_ns(tracks, tracks.color, times_s)
    straighten = Straightener(tracks.camera_info, ideal_camera(tracks.camera_info))
    found = images(tmp_path / "log", topics.color, wanted, straighten, depth=False)
    np.testing.assert_allclose([image.mean() for image in found], np.round(40 * times_s))


@pytest.mark.parametrize("focal_px", [0.0, 35.0])
def test_rectified_images_are_not_straightened_again(tmp_path: Path, focal_px: float) -> None:
    def change(info: Any, _: int) -> None:
        info.d = np.array([0.1, -0.05, 0.0, 0.0, 0.0])
        info.p = np.zeros(12)
        info.p[[0, 5, 10]] = focal_px, focal_px, 1.0
        info.p[[2, 6]] = (WIDTH - 1) / 2, (HEIGHT - 1) / 2

    topic = "/camera/image_rect_color"
    log = each(INFO, change)(log_messages(seconds=2.0))
    write_messages(tmp_path / "log", [(t, topic if n == COLOR else n, k, m) for t, n, k, m in log])
    topics = read_topic_map(topic_map(tmp_path, TOPICS.replace(COLOR, topic)))
    tracks = read_tracks(tmp_path / "log", topics)
    assert tracks.camera_info.k[0] == (focal_px or FOCAL_PX)
    assert f"{topic}: taken as straightened already, as its name says" in tracks.doubts
    picture = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    straighten = Straightener(tracks.camera_info, ideal_camera(tracks.camera_info))
    straight = straighten(picture, cv2.INTER_LINEAR)
    np.testing.assert_array_equal(straight, picture)


def test_a_walk_comes_back(tmp_path: Path) -> None:
    made = read_episode_unit(write_unit(tmp_path, make_rollout(3.0)))
    ros2_from_unit(made.folder, tmp_path / "walk")
    topics = TopicMap()
    tracks = read_tracks(tmp_path / "walk", topics)
    (span,) = spans(tmp_path, tracks, topics)
    rows = row_arrays(made.rows())
    unit_from_log(
        tmp_path / "walk",
        tracks,
        topics,
        span,
        tmp_path / "back",
        robot="aliengo",
        joint_names=tracks.joint_names,
        base_height_m=float(rows["observation.state"][0, 2]),
        rate=4,
        split="train",
    )
    back = read_episode_unit(tmp_path / "back")
    again = row_arrays(back.rows())
    assert back.task == made.task and camera_of(back.columns).hfov_deg == 90.0
    for key in ("observation.joints", "observation.imu", "action.velocity", "observation.progress"):
        np.testing.assert_array_equal(again[key], rows[key])
    for key in ("observation.state", "observation.camera_pose", "action"):
        np.testing.assert_allclose(again[key], rows[key], atol=3e-6)
    for a, b in zip(back.depth_m(range(13)), made.depth_m(range(13)), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(frames(back), frames(made), strict=True):
        assert np.abs(a.astype(int) - b).mean() < 3  # compressed twice more


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.95])
def test_damaged_bags_are_named(tmp_path: Path, kept: float) -> None:
    write_log(tmp_path / "log", seconds=2.0)
    file = tmp_path / "log" / "log.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: int(kept * len(data))])
    out = tmp_path / "out"
    command = ["convert", str(tmp_path / "log"), "--robot", "dog", "--base-height-m", "0.3"]
    command += ["--map", str(topic_map(tmp_path)), "--out", str(out)]
    assert cli.main(command) == 2
    assert not list(out.glob("lerobot/*"))
    with pytest.raises(FileFormatError, match="log"):
        read_tracks(tmp_path / "log", read_topic_map(tmp_path / "topics.yaml"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("odom: /odom", "unknown field 'odom'"),
        ("max_gap_s: -1", "max_gap_s: -1.0; valid"),
        ("end_reason: fine", "end_reason: 'fine'; valid"),
        ("[1]", "not a mapping"),
    ],
)
def test_invalid_maps_are_named(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(FileFormatError, match=reason):
        read_topic_map(topic_map(tmp_path, text))


@pytest.mark.usefixtures("inline")
def test_the_command_writes_a_dataset(tmp_path: Path) -> None:
    write_log(tmp_path / "log", hole=(2.5, 4.0))
    (tmp_path / "text.txt").write_text("Walk straight on.\n")
    command = ["convert", str(tmp_path / "log"), "--from", "ros2", "--robot", "dog"]
    command += ["--base-height-m", "0.3", "--map", str(topic_map(tmp_path))]
    command += ["--instruction", str(tmp_path / "text.txt"), "--out", str(tmp_path / "out")]
    assert cli.main(command) == 0
    opened = open_dataset(tmp_path / "out" / "lerobot" / "log")
    assert len(opened.episodes) == 2
    told = json.loads((opened.root / "meta" / "provenance.json").read_text())["converted"]
    np.testing.assert_allclose(told["spans_s"], [[0.0, 2.5], [4.0, 5.95]], atol=0.1)
    units = sorted((tmp_path / "out" / "units" / "log").iterdir())
    first, second = (read_episode_unit(unit) for unit in units)
    # Held out together, for they were recorded in one place.
    assert first.columns["scene_id"] == second.columns["scene_id"] == "log"
    assert first.task == second.task == "Walk straight on."
