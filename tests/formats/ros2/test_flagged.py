"""Logs with wrong clocks, leaps and ends: no value moves in time, and the data tells of it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.support.robot_logs import (
    COLOR,
    DEPTH,
    JOINTS,
    ODOM,
    Change,
    Logged,
    convert_log,
    each,
    log_messages,
    make,
    moving_mount,
    position,
    shifted,
    topic_map,
    without,
    write_log,
    write_messages,
)
from vlnpe.formats.lerobot import read_episode_unit
from vlnpe.formats.lerobot.units.rows import row_arrays
from vlnpe.formats.ros2.topic_map import read_topic_map
from vlnpe.formats.ros2.tracks import Tracks, read_tracks

pytestmark = pytest.mark.usefixtures("inline")


def test_the_quality_of_service_may_stand_in_the_metadata_alone(tmp_path: Path) -> None:
    """As `ros2 bag convert` leaves it."""
    write_log(tmp_path / "walk", seconds=2.0)
    metadata = tmp_path / "walk" / "metadata.yaml"
    with_it = yaml.safe_load(metadata.read_text())
    offered = {"history": "keep_last", "depth": 1, "reliability": "best_effort"}
    forever = {"sec": 0, "nsec": 0}
    offered |= {"durability": "volatile", "deadline": forever, "lifespan": forever}
    offered |= {"liveliness": "automatic", "liveliness_lease_duration": forever}
    offered |= {"avoid_ros_namespace_conventions": False}
    for topic in with_it["rosbag2_bagfile_information"]["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = [offered]
    metadata.write_text(yaml.safe_dump(with_it))
    assert convert_log(tmp_path / "walk")[0] == 0


def stuck(message: Any, _: int) -> None:
    message.header.stamp.sec = message.header.stamp.nanosec = 0


CLOCKS: dict[str, tuple[Change, str]] = {
    "ahead": (each(ODOM, lambda m, k: shifted(m, 5.0 * (k > 40))), "leaps ahead"),
    "back": (each(ODOM, lambda m, k: shifted(m, -0.4 * (k > 40))), "runs backwards"),
    "fast": (each(ODOM, lambda m, k: shifted(m, 0.5 * k / 37)), "at another speed"),
    "none": (each(ODOM, stuck), "stands still"),
    "colour back": (each(COLOR, lambda m, k: shifted(m, -5.0 * (k > 20))), "runs backwards"),
    "late": (each(ODOM, lambda m, _: shifted(m, -3600.0)), "3600.000 s behind the recorder's"),
}


@pytest.mark.parametrize("case", CLOCKS)
def test_a_clock_that_is_wrong_is_told_and_puts_nothing_at_the_wrong_time(
    tmp_path: Path, case: str
) -> None:
    change, doubt = CLOCKS[case]
    write_messages(tmp_path / "walk", change(log_messages(seconds=4.0)))
    status, out = convert_log(tmp_path / "walk")
    assert status == 0
    dataset = out / "lerobot" / "walk"
    assert doubt in (dataset / "meta" / "provenance.json").read_text()
    unit = read_episode_unit(out / "units" / "walk" / "walk-000")
    times = np.arange(unit.length) / 4
    seen = row_arrays(unit.rows())["observation.state"][:, :2]
    np.testing.assert_allclose(seen, np.stack([position(t) for t in times])[:, :2], atol=2e-3)


def test_topics_on_one_other_clock_keep_their_places_to_each_other(tmp_path: Path) -> None:
    """Latencies differ, and the robot's clock is an hour behind: it is one shift."""
    late_s = {ODOM: 0.01, COLOR: 0.25, DEPTH: 0.4, JOINTS: 0.03, "/tf": 0.02}
    log = moving_mount(log_messages(seconds=3.0))
    write_messages(tmp_path / "good", log)
    for _, _, _, message in log:
        for part in getattr(message, "transforms", [message]):
            if hasattr(part, "header"):
                shifted(part, -3600.0)
    write_messages(tmp_path / "walk", [(t + late_s.get(n, 0.0), n, k, m) for t, n, k, m in log])
    topics = read_topic_map(topic_map(tmp_path))
    good, found = (read_tracks(tmp_path / name, topics) for name in ("good", "walk"))

    def times(tracks: Tracks) -> list[np.ndarray]:
        parts = (tracks.odometry, tracks.color, tracks.depth, tracks.joints)
        assert all(parts)
        return [part.time_s for part in (*parts, tracks.frames["optical"][1]) if part]

    for a, b in zip(times(good), times(found), strict=True):
        np.testing.assert_allclose(b - a, times(found)[0][0] - times(good)[0][0], atol=1e-8)
    assert abs(times(found)[0][0] - 0.01) < 1e-6 and not good.doubts
    shifts = [doubt for doubt in found.doubts if "shifted" in doubt]
    assert len(shifts) == 1 and "3600.010 s behind the recorder's" in shifts[0]
    assert any(d.startswith(f"{COLOR}: recorded 0.240 s after its stamps") for d in found.doubts)


def leap(message: Any, number: int) -> None:
    message.pose.pose.position.x += 50.0 * (number > 74)


def another_text(log: list[Logged]) -> list[Logged]:
    texts = ((0.0, "First."), (1.0, "First."), (2.0, "Second."))
    kind = "std_msgs/String"
    return [*log, *((t, "/instruction", kind, make(kind, text)) for t, text in texts)]


CUTS: dict[str, tuple[Change, list[int], list[str]]] = {
    "lost odometry": (each(ODOM, leap), [8, 8], ["", ""]),
    "new instruction": (another_text, [9, 8], ["First.", "Second."]),
    "depth ends": (without(DEPTH, after_s=2.0), [9], [""]),
    "joints end": (without(JOINTS, after_s=2.0), [9], [""]),
    "no numbers": (
        each(ODOM, lambda m, k: k > 74 and setattr(m.pose.pose.position, "x", np.nan)), [9], [""]
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CUTS)
def test_episodes_end_where_the_log_stops_to_tell(tmp_path: Path, case: str) -> None:
    change, lengths, texts = CUTS[case]
    write_messages(tmp_path / "walk", change(log_messages(seconds=4.0)))
    status, out = convert_log(tmp_path / "walk")
    assert status == 0
    units = [read_episode_unit(path) for path in sorted((out / "units" / "walk").iterdir())]
    assert [unit.task for unit in units] == texts
    np.testing.assert_allclose([unit.length for unit in units], lengths, atol=1)


def test_joints_of_another_publisher_are_left_out_and_told(tmp_path: Path) -> None:
    log = log_messages(seconds=2.0)
    for time_s, name, kind, message in log_messages(seconds=2.0):
        if name == JOINTS:
            message.name, message.position, message.velocity = ["arm"], np.ones(1), np.ones(1)
            log.append((time_s - 1e-3 if time_s else 0.0, name, kind, message))
    write_messages(tmp_path / "walk", log)
    status, out = convert_log(tmp_path / "walk")
    assert status == 0
    (dataset,) = (out / "lerobot").iterdir()
    assert "other joints left out: ('arm',)" in (dataset / "meta" / "provenance.json").read_text()


def test_the_instruction_file_is_a_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "walk", seconds=2.0)
    (tmp_path / "text.txt").write_bytes(b"ab\xff")
    assert convert_log(tmp_path / "walk", "--instruction", str(tmp_path / "text.txt"))[0] == 2
    assert "text.txt: not a text in UTF-8" in capsys.readouterr().err


def test_texts_are_written_after_the_conversion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    write_log(tmp_path / "walk", seconds=4.0, hole=(1.5, 2.5))
    status, out = convert_log(tmp_path / "walk")
    units = sorted((out / "units" / "walk").iterdir())
    assert "2 of 2 walks have no instruction" in caplog.text
    first = (units[0] / "unit.json").stat().st_mtime_ns
    texts = tmp_path / "texts.json"
    texts.write_text('{"walk-001": "Go past\\nthe sofa."}')
    assert status == 0 and convert_log(tmp_path / "walk", "--instruction", str(texts))[0] == 0
    assert [read_episode_unit(unit).task for unit in units] == ["", "Go past the sofa."]
    assert "1 of 2 walks have no instruction" in caplog.text
    assert (units[0] / "unit.json").stat().st_mtime_ns == first  # made once
    for text, reason in (('{"walk-002": "Go."}', "walk-002"), ('{"walk-000": 1}', "a text for")):
        texts.write_text(text)
        assert convert_log(tmp_path / "walk", "--instruction", str(texts))[0] == 2
        assert reason in capsys.readouterr().err
