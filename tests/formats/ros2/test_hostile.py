"""Logs that are damaged, incomplete or wrong: an error names the file and the reason."""

import copy
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.support.robot_logs import (
    COLOR,
    DEPTH,
    HEIGHT,
    INFO,
    ODOM,
    WIDTH,
    Change,
    Logged,
    convert_log,
    each,
    log_messages,
    make,
    moving_mount,
    without,
    write_log,
    write_messages,
)
from vlnpe.formats.convert.dataset import open_dataset

pytestmark = pytest.mark.usefixtures("inline")


def typed(topic: str, kind: str, of: Callable[[Any], Any]) -> Change:
    """Give a topic another type."""
    return lambda log: [(t, n, kind, of(m)) if n == topic else (t, n, k, m) for t, n, k, m in log]


def calibration(**values: Any) -> Change:
    return each(INFO, lambda info, _: [setattr(info, k, v) for k, v in values.items()])


def picture(data: np.ndarray) -> Change:
    """Give the frames after 1 s as a compressed picture."""
    good = cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].ravel()
    kind = "sensor_msgs/CompressedImage"

    def changed(log: list[Logged]) -> list[Logged]:
        return [
            (t, n, kind, make(kind, m.header, "jpeg", data if t > 1 else good)) if n == COLOR
            else (t, n, k, m)
            for t, n, k, m in log
        ]  # fmt: skip

    return changed


def mount(**values: Any) -> Change:
    """Change the transform of the camera, or its rotation."""

    def changed(message: Any, _: int) -> None:
        (part,) = message.transforms
        for key, value in values.items():
            place = part.header if key == "frame_id" else part.transform.rotation
            setattr(place, key, value)

    return each("/tf_static", changed)


def second_mount(log: list[Logged]) -> list[Logged]:
    """Let the transforms of the camera's frame go round."""
    (message,) = (m for _, n, _, m in log if n == "/tf_static")
    other = copy.deepcopy(message.transforms[0])
    message.transforms[0].header.frame_id = other.child_frame_id = "mount"
    other.header.frame_id = "optical"
    message.transforms.append(other)
    return log


def second_camera(log: list[Logged]) -> list[Logged]:
    extra = [(t + 0.01, n, k, copy.deepcopy(m)) for t, n, k, m in log if n == COLOR]
    return [*each(COLOR, lambda m, _: setattr(m.header, "frame_id", "rear"))(extra), *log]


def second_calibration(log: list[Logged]) -> list[Logged]:
    extra = [(1.0, n, k, copy.deepcopy(m)) for _, n, k, m in log if n == INFO]
    return [*calibration(k=np.full(9, 50.0))(extra), *log]


def moving_mount_that_stops(log: list[Logged]) -> list[Logged]:
    return [m for m in moving_mount(log) if m[1] != "/tf" or m[0] < 0.5]


NOISE = np.random.default_rng(0).integers(0, 255, 500, np.uint8)
WHOLE = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)))[1]
BOMB = cv2.imencode(".png", np.zeros((9000, 9000), np.uint8))[1].ravel()
HUGE = {"width": 100_000, "height": 100_000}
WRONG: dict[str, tuple[Change, str]] = {
    "empty": (lambda _: [], f"has no nav_msgs/msg/Odometry on '{ODOM}'; topics of that type: none"),
    "no odometry": (without(ODOM), "has no nav_msgs/msg/Odometry"),
    "no colour": (without(COLOR), f"topics of that type: {DEPTH}"),
    "no calibration": (without(INFO), "has no sensor_msgs/msg/CameraInfo"),
    "no transforms": (without("/tf_static"), "they end at 'optical'"),
    "a loop of transforms": (second_mount, "do not lead from 'optical' to base_frame"),
    "a slash": (mount(frame_id="/base_link"), "they end at '/base_link'"),
    "a zero rotation": (mount(w=0.0, x=0.0, y=0.0, z=0.0), "they end at 'optical'"),
    "a mount that stops": (moving_mount_that_stops, "transform to optical 0.0–0.5 s with gaps"),
    "odometry of another frame": (
        each(ODOM, lambda m, _: setattr(m, "child_frame_id", "camera")),
        "tells where camera is; valid: base_frame, which is base_link",
    ),
    "odometry without rotation": (
        each(ODOM, lambda m, _: setattr(m.pose.pose.orientation, "w", 0.0)),
        "no message holds a pose",
    ),
    "odometry of another type": (
        typed(ODOM, "geometry_msgs/Pose", lambda m: m.pose.pose),
        "is of type geometry_msgs/msg/Pose; valid: nav_msgs/msg/Odometry",
    ),
    "texts as pictures": (
        typed(COLOR, "std_msgs/String", lambda _: make("std_msgs/String", "x" * 40)),
        "is of type std_msgs/msg/String; valid: sensor_msgs/msg/Image",
    ),
    "no focal length": (calibration(k=np.zeros(9)), "not calibrated: focal lengths 0"),
    "no number": (calibration(d=np.full(5, np.nan)), "not calibrated"),
    "3 coefficients": (calibration(d=np.zeros(3)), "with 3 coefficients"),
    "a fisheye": (calibration(distortion_model="equidistant"), "'equidistant'"),
    "no size": (calibration(width=0), "images of 0 × 48"),
    "a huge size": (calibration(**HUGE), "images of 100000 × 100000"),
    "two calibrations": (second_calibration, "the calibration changes"),
    "another camera's calibration": (
        each(INFO, lambda m, _: setattr(m.header, "frame_id", "rear")),
        "a calibration of rear, but images of optical",
    ),
    "two cameras": (second_camera, "holds images of optical and rear"),
    "depth elsewhere": (
        each(DEPTH, lambda m, _: setattr(m.header, "frame_id", "infrared")),
        "depth in 'infrared', colour in 'optical'; valid: depth aligned to colour",
    ),
    "half a picture": (picture(WHOLE.ravel()[: WHOLE.size // 2]), "an incomplete image"),
    "no picture": (picture(NOISE[:0]), "not an image of format 'jpeg'"),
    "noise": (picture(NOISE), "not an image of format 'jpeg'"),
    "a bomb": (picture(BOMB), "9000 × 9000 px; its calibration has 64 × 48"),
    "short rows": (each(COLOR, lambda m, _: setattr(m, "step", 191)), "9216 bytes of 48 × 191"),
    "a wide picture": (each(COLOR, lambda m, _: setattr(m, "width", 640)), "640 × 48 px"),
    "an encoding": (each(COLOR, lambda m, _: setattr(m, "encoding", "yuv422")), "'yuv422'"),
    "inverse depth": (
        typed(
            DEPTH,
            "sensor_msgs/CompressedImage",
            lambda m: make(
                "sensor_msgs/CompressedImage",
                m.header,
                "32FC1; compressedDepth png",
                np.append(
                    np.zeros(12, np.uint8),
                    cv2.imencode(".png", np.zeros((HEIGHT, WIDTH), np.uint16))[1],
                ),
            ),
        ),
        "no PNG of 16-bit millimetres",
    ),
    "too short": (lambda log: [m for m in log if m[0] < 0.5], "no 1 s without a gap over 0.5 s"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_log_is_named_with_the_reason_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    change, reason = WRONG[case]
    write_messages(tmp_path / "walk", change(log_messages(seconds=2.0)))
    status, out = convert_log(tmp_path / "walk")
    said = capsys.readouterr().err
    assert status == 2 and f"{tmp_path / 'walk'}: " in said and reason in said
    assert "Traceback" not in said
    assert not list(out.glob("*/*"))


def as_fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def as_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("/etc/passwd")


@pytest.mark.parametrize(
    ("name", "damage", "reason"),
    [
        ("walk.mcap", Path.unlink, "damaged bag: Some database files are missing"),
        ("walk.mcap", as_fifo, "walk.mcap: is a FIFO"),
        ("walk.mcap", as_link, "walk.mcap: leads out of"),
        ("metadata.yaml", as_fifo, "metadata.yaml: is a FIFO"),
        ("metadata.yaml", lambda path: path.write_text("[1, 2]"), "damaged bag: Invalid bag"),
        ("metadata.yaml", lambda path: path.write_bytes(b"\xff\xfe"), "damaged bag: 'utf-8'"),
    ],
)
def test_damaged_files_are_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    damage: Callable[[Path], Any],
    reason: str,
) -> None:
    write_log(tmp_path / "walk", seconds=2.0)
    damage(tmp_path / "walk" / name)
    status, out = convert_log(tmp_path / "walk")
    assert status == 2 and reason in capsys.readouterr().err
    assert not list(out.glob("*/*"))


def test_a_recorder_that_was_killed_left_no_metadata(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "walk", seconds=2.0)
    (tmp_path / "walk" / "metadata.yaml").unlink()
    assert convert_log(tmp_path / "walk")[0] == 0
    file = tmp_path / "walk" / "walk.mcap"
    file.write_bytes(file.read_bytes()[:-1000])
    assert convert_log(tmp_path / "walk")[0] == 2
    assert "`ros2 bag reindex` or `mcap recover`" in capsys.readouterr().err


def test_bags_with_one_name_are_named_before_any_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = tmp_path / "bags"
    for day in ("mon", "tue"):
        (bags / day).mkdir(parents=True)
        write_messages(bags / day / "walk", [])
    status, out = convert_log(bags)
    said = capsys.readouterr().err
    assert status == 2 and f"{bags / 'mon' / 'walk'}, {bags / 'tue' / 'walk'}: " in said
    assert "rename one" in said and not list(out.glob("*/*"))


def test_a_bad_bag_may_be_called_like_an_episode_of_a_good_one(tmp_path: Path) -> None:
    bags = tmp_path / "bags"
    bags.mkdir()
    write_log(bags / "a", seconds=2.0)
    write_messages(bags / "a-000", [])
    status, out = convert_log(bags)
    assert status == 1 and "a-000-000" in (out / "quarantine.json").read_text()
    assert len(open_dataset(out / "lerobot" / "bags").episodes) == 1


def test_one_bad_bag_of_several_is_quarantined(tmp_path: Path) -> None:
    bags = tmp_path / "bags"
    bags.mkdir()
    write_log(bags / "a", seconds=2.0)
    write_messages(bags / "b", [])
    write_log(bags / "c", seconds=2.0)
    status, out = convert_log(bags)
    assert status == 1 and "has no nav_msgs/msg/Odometry" in (out / "quarantine.json").read_text()
    assert len(open_dataset(out / "lerobot" / "bags").episodes) == 2
