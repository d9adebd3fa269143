"""Depth of robots' logs that has a calibration of its own, which may not fit."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.formats.ros2.test_import import convert
from tests.support.robot_logs import (
    DEPTH,
    FOCAL_PX,
    HEIGHT,
    INFO,
    TOPICS,
    WIDTH,
    each,
    log_messages,
    topic_map,
    write_log,
    write_messages,
)
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.ros2.topic_map import read_topic_map
from vlnpe.formats.ros2.tracks import read_tracks


@pytest.mark.parametrize("name", ["image_raw", "image_rect", "image_raw/compressedDepth"])
def test_depth_is_mapped_by_its_own_calibration(tmp_path: Path, name: str) -> None:
    """Colour is distorted; depth, of another focal length, is not, or is straightened."""
    topic, focal_px, bent = f"/camera/depth/{name}", 30.0, np.array([0.2, -0.1, 0.0, 0.0, 0.0])
    center = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    slope = (np.arange(WIDTH) - center[0]) / focal_px
    wall = np.tile(1000 * (2.0 + slope), (HEIGHT, 1)).astype(np.uint16)  # turned from the camera

    def bend(info: Any, _: int) -> None:
        info.d = bent

    def own(info: Any, _: int) -> None:
        k = np.array([focal_px, 0, center[0], 0, focal_px, center[1], 0, 0, 1])
        info.d, info.p = np.zeros(5), np.insert(k, [3, 6, 9], 0.0)
        if name == "image_rect":  # then `p` is the pixels', not `k`
            info.d, info.k = bent, 2 * k
        else:
            info.k = k

    log = log_messages(seconds=2.0)
    others = copy.deepcopy([message for message in log if message[1] == INFO])
    log = each(DEPTH, lambda m, _: setattr(m, "data", wall.reshape(-1).view(np.uint8)))(log)
    log = [(t, topic if n == DEPTH else n, k, m) for t, n, k, m in each(INFO, bend)(log)]
    log += [(t, "/camera/depth/camera_info", k, m) for t, _, k, m in each(INFO, own)(others)]
    write_messages(tmp_path / "log", log)
    topics = TOPICS.replace(DEPTH, topic)
    doubts = read_tracks(tmp_path / "log", read_topic_map(topic_map(tmp_path, topics))).doubts
    assert any("focal length of 30.0 px, straight and" in doubt for doubt in doubts)
    (rows,) = convert(tmp_path / "log", tmp_path / "units", topics=topics)
    expected = 2.0 + (np.arange(WIDTH) - center[0]) / FOCAL_PX
    for metres in rows["depth"]:
        np.testing.assert_allclose(metres, np.tile(expected, (HEIGHT, 1)), atol=0.02)


OWN = "/camera/camera/aligned_depth_to_color/camera_info"


@pytest.mark.parametrize(
    ("own", "doubt"),
    [
        ({"k": np.zeros(9)}, "not calibrated: focal lengths 0 and 0"),
        ({"frame_id": "depth"}, "of depth, but images of optical"),
        ({"width": 0}, "images of 0 × 48"),
        ({}, "the calibration changes"),
    ],
)
def test_a_calibration_of_depth_that_does_not_fit_is_doubted_and_colours_taken(
    tmp_path: Path, own: dict[str, Any], doubt: str
) -> None:
    log = log_messages(seconds=2.0)
    infos = copy.deepcopy([message for message in log if message[1] == INFO])
    if not own:
        infos += [(1.0, *message[1:]) for message in copy.deepcopy(infos)]
        own = {"k": np.array([30.0, 0, 20, 0, 30, 20, 0, 0, 1])}
    for key, value in own.items():
        place = infos[-1][3]
        setattr(place.header if key == "frame_id" else place, key, value)
    write_messages(tmp_path / "log", [*log, *((t, OWN, k, m) for t, _, k, m in infos)])
    tracks = read_tracks(tmp_path / "log", read_topic_map(topic_map(tmp_path)))
    assert tracks.depth_info is tracks.camera_info
    (told,) = (told for told in tracks.doubts if told.startswith(OWN))
    assert doubt in told and "colour's" in told


def test_depth_of_odd_size_is_mapped_by_its_own_calibration(tmp_path: Path) -> None:
    log, (width, height) = log_messages(seconds=2.0), (WIDTH - 1, HEIGHT - 1)
    infos = copy.deepcopy([message for message in log if message[1] == INFO])
    for *_, info in infos:
        info.width, info.height = width, height

    def crop(image: Any, _: int) -> None:
        image.width, image.height, image.step = width, height, 2 * width
        image.data = np.full((height, width), 2000, np.uint16).reshape(-1).view(np.uint8)

    log = [*each(DEPTH, crop)(log), *((t, OWN, k, m) for t, _, k, m in infos)]
    write_messages(tmp_path / "log", log)
    (rows,) = convert(tmp_path / "log", tmp_path / "units")
    np.testing.assert_allclose(rows["depth"][0][:height, :width], 2.0, atol=0.01)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "/camera/depth/camera_info"),
        ("depth: /a/depth/image_raw/compressedDepth", "/a/depth/camera_info"),
        ("depth: /depth", ""),
        ("depth: /depth\ndepth_info: /info", "/info"),
        ("depth: ''", ""),
    ],
)
def test_depths_own_calibration_is_beside_it_or_where_the_map_says(
    tmp_path: Path, text: str, expected: str
) -> None:
    topics = read_topic_map(topic_map(tmp_path, text or "depth: /camera/depth/image_raw"))
    assert topics.depth_info_topic == expected


def test_a_named_calibration_of_depth_must_be_there(tmp_path: Path) -> None:
    write_log(tmp_path / "log", seconds=2.0)
    topics = read_topic_map(topic_map(tmp_path, f"{TOPICS}depth_info: /info\n"))
    with pytest.raises(FileFormatError, match="has no sensor_msgs/msg/CameraInfo on '/info'"):
        read_tracks(tmp_path / "log", topics)
