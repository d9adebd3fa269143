"""Episodes in MCAP: complete, geometrically right, and readable by others."""

import json
import re
import shutil
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from mcap.reader import make_reader

from tests.formats.mcap.test_rollout import assert_same, message_type
from tests.support.rollouts import make_frames, make_images, make_rollout, with_body
from vlnpe.formats.core.camera import CameraModel, DepthRange
from vlnpe.formats.core.errors import FileFormatError
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.mcap.episode import write_episode_mcap
from vlnpe.formats.mcap.robot_links import LinkShape, RobotLinks, robot_topics
from vlnpe.formats.mcap.rollout import read_rollout
from vlnpe.formats.mcap.shown import BLOCKED, FREE, map_topic
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.scene.freemap import Freemap
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.formats.video.depth_codes import depth_to_codes
from vlnpe.formats.video.mp4 import read_rgb_video, write_depth_video, write_rgb_video

LAYOUT = Path(__file__).resolve().parents[3] / "docs" / "reference" / "foxglove_layout.json"
CAMERA = CameraModel("front", 96, 64, 90.0)
RANGE = DepthRange(0.05, 20.0)
META = {
    "camera": {"name": "front", "width_px": 96, "height_px": 64, "hfov_deg": 90.0},
    "depth": {"file": "depth.mp4", "near_m": RANGE.near_m, "far_m": RANGE.far_m},
    "rgb": {"file": "rgb.mp4", "codec": "h264"},
    "frames_per_second": 4,
    "light": "baked",
}
OFFICIAL = {
    "/tf": "FrameTransforms",
    "/camera/tf": "FrameTransforms",
    "/base/pose": "PoseInFrame",
    "/joint_states": "JointStates",
    "/events": "Log",
    "/plan": "SceneUpdate",
    "/camera/rgb": "CompressedVideo",
    "/camera/depth": "RawImage",
    "/camera/calibration": "CameraCalibration",
    "/map": "Grid",
    "/robot": "SceneUpdate",
    "/robot/tf": "FrameTransforms",
}


def small_map() -> Freemap:
    """2 × 3 cells of 0.5 m: no floor in the first, something on the last."""
    floor = np.array([[np.nan, 0.1, 0.1], [0.1, 0.1, 0.1]], np.float32)
    free = np.array([[False, True, True], [True, True, False]])
    return Freemap(GridSpec((1.0, 2.0), 0.5, 2, 3), floor, free)


def small_links(rollout: Rollout) -> RobotLinks:
    """A body of one cube 0.2 m ahead of the base, and a turned wheel beneath it."""
    turned, still = np.array([np.sqrt(0.5), np.sqrt(0.5), 0, 0]), np.array([1.0, 0, 0, 0])
    cube = LinkShape("cube", np.array([0.2, 0, 0]), still, np.array([0.3, 0.2, 0.1]), (1, 0, 0, 1))
    wheel = LinkShape("cylinder", np.zeros(3), turned, np.array([0.2, 0.2, 0.05]), (0, 0, 0, 1))
    times = rollout.time_s[::5]
    position = np.tile([[0.0, 0, 0], [0, 0, -0.1]], (len(times), 1, 1))
    rotation = np.tile(still, (len(times), 2, 1))
    return RobotLinks(("trunk", "wheel"), ((cube,), (wheel,)), times, position, rotation)


def write_frame_folder(folder: Path, rollout: Rollout, rate: int = 4, codec: str = "h264") -> None:
    """Write what the render stage writes."""
    folder.mkdir()
    frames = make_frames(rollout, rate)
    rgb, depth = make_images(len(frames["sample_index"]))
    write_rgb_video(folder / "rgb.mp4", rgb, rate, codec)
    write_depth_video(folder / "depth.mp4", depth, rate, RANGE)
    np.savez(folder / "frames.npz", **frames)  # pyright: ignore[reportArgumentType]
    meta = META | {"rgb": {"file": "rgb.mp4", "codec": codec}, "frames_per_second": rate}
    (folder / "meta.json").write_text(json.dumps(meta))


def decode(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Every topic's (log time, message), decoded by each file's own schemas."""
    result = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.message_encoding == "json":
                value = json.loads(message.data)
            else:
                value = message_type(schema.name, schema.data).FromString(message.data)
            result[channel.topic].append((message.log_time, value))
    return result


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Rollout, Path]:
    root = tmp_path_factory.mktemp("episode")
    rollout = make_rollout(5.0, 2, discrete=True)
    write_frame_folder(root / "frames", rollout)
    path = root / "ep.mcap"
    shown = (map_topic((0.0, small_map())), *robot_topics(small_links(rollout)))
    write_episode_mcap(path, rollout, root / "frames", shown=shown)
    return path, rollout, root / "frames"


def test_the_rollout_is_in_it_exactly(written: tuple[Path, Rollout, Path]) -> None:
    assert_same(written[1], read_rollout(written[0]))


def test_topics_have_foxgloves_own_schemas(written: tuple[Path, Rollout, Path]) -> None:
    import foxglove.messages

    with written[0].open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    topics = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
    assert set(topics) == {*OFFICIAL, "/state", "/command", "/action", "/imu", "/foot_contact"}
    for topic, name in OFFICIAL.items():
        official = getattr(foxglove.messages, name).get_schema()
        assert topics[topic].name == official.name == f"foxglove.{name}"
        assert topics[topic].data == official.data


def test_indexes_times_and_metadata(written: tuple[Path, Rollout, Path]) -> None:
    path, rollout, _ = written
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.chunk_indexes
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        times = [m.log_time for *_, m in reader.iter_messages(log_time_order=False)]
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        attachments = list(reader.iter_attachments())
    assert times == sorted(times) and times[-1] == round(rollout.time_s[-1] * 1e9)
    assert metadata["vlnpe.instruction"]["text"] == rollout.episode.instruction
    assert json.loads(metadata["vlnpe.view"]["json"])["light"] == "baked"
    assert [(a.name, a.media_type) for a in attachments] == [("frames.npz", "application/x-npz")]


@pytest.mark.parametrize("codec", ["h264", "av1"])
def test_colour_is_the_videos_own_stream(tmp_path: Path, codec: str) -> None:
    rollout = make_rollout(2.0)
    write_frame_folder(tmp_path / "frames", rollout, codec=codec)
    write_episode_mcap(tmp_path / "a.mcap", rollout, tmp_path / "frames")
    messages = [m for _, m in decode(tmp_path / "a.mcap")["/camera/rgb"]]
    assert {m.format for m in messages} == {codec}
    # Each message must decode to exactly one image, from the messages alone.
    decoder: Any = av.CodecContext.create("h264" if codec == "h264" else "libdav1d", "r")
    decoder.thread_count = 1
    images = [image for m in messages for image in decoder.decode(av.Packet(m.data))]
    images += decoder.decode(None)
    expected = read_rgb_video(tmp_path / "frames" / "rgb.mp4")
    assert len(images) == len(expected) == 9
    for image, frame in zip(images, expected, strict=True):
        np.testing.assert_array_equal(image.to_ndarray(format="rgb24"), frame)


def test_depth_is_whole_millimetres(written: tuple[Path, Rollout, Path]) -> None:
    messages = decode(written[0])["/camera/depth"]
    _, depth = make_images(len(messages))
    for (at, message), truth, k in zip(messages, depth, range(21), strict=True):
        assert at == k * 250_000_000
        layout = (message.encoding, message.width, message.height, message.step)
        assert layout == ("16UC1", 96, 64, 192)
        image = np.frombuffer(message.data, "<u2").reshape(64, 96)
        np.testing.assert_allclose(image / 1000, truth, atol=0.004)
        assert np.all(image[:6, :6] == 0)
        # Rounding to millimetres loses none of the video's depth codes.
        metres = (image / 1000).astype(np.float32)
        np.testing.assert_array_equal(depth_to_codes(metres, RANGE), depth_to_codes(truth, RANGE))


def rotation(q: Any) -> np.ndarray:
    return quat_to_matrix([q.w, q.x, q.y, q.z])


def test_transforms_chain_from_world_to_camera(written: tuple[Path, Rollout, Path]) -> None:
    path, rollout, _ = written
    topics = decode(path)
    frames = make_frames(rollout)
    bases = {at: m.transforms[0] for at, m in topics["/tf"]}
    assert len(topics["/camera/tf"]) == 21
    for i, (at, message) in enumerate(topics["/camera/tf"]):
        base, camera = bases[at], message.transforms[0]
        assert (base.parent_frame_id, base.child_frame_id) == ("world", "base")
        assert (camera.parent_frame_id, camera.child_frame_id) == ("base", "camera_optical")
        b, c = base.translation, camera.translation
        turn = rotation(base.rotation)
        position = turn @ [c.x, c.y, c.z] + [b.x, b.y, b.z]
        np.testing.assert_allclose(position, frames["camera_position_world_m"][i], atol=1e-9)
        axes = quat_to_matrix(frames["camera_quat_wxyz"][i])
        np.testing.assert_allclose(turn @ rotation(camera.rotation), axes, atol=1e-9)


def test_calibration_joints_commands_actions_events_plan(
    written: tuple[Path, Rollout, Path],
) -> None:
    path, rollout, _ = written
    topics = decode(path)
    calibration = topics["/camera/calibration"][0][1]
    np.testing.assert_allclose(np.reshape(calibration.K, (3, 3)), CAMERA.intrinsics)
    assert (calibration.width, calibration.height) == (96, 64)
    assert calibration.frame_id == "camera_optical"
    joint = topics["/joint_states"][3][1].joints[1]
    assert joint.name == rollout.joint_names[1]
    assert joint.position == rollout.joint_position_rad[15, 1]
    assert joint.effort == rollout.joint_torque_nm[15, 1]
    assert topics["/command"][2][1]["vx_base_m_s"] == rollout.command[10, 0]
    assert [a["id"] for _, a in topics["/action"]] == [int(a.action) for a in rollout.actions]
    assert not any(action["derived"] for _, action in topics["/action"])
    assert [m.message for _, m in topics["/events"]] == ["contact: Table_1", "stop", "end: success"]
    entity = topics["/plan"][0][1].entities[0]
    line = [(p.x, p.y, p.z) for p in entity.lines[0].points]
    np.testing.assert_array_equal(line, rollout.episode.reference_path_world_m)


def test_path_control_has_the_labels_of_its_frames(tmp_path: Path) -> None:
    rollout = make_rollout(3.0)
    assert not rollout.actions
    write_frame_folder(tmp_path / "frames", rollout)
    write_episode_mcap(tmp_path / "a.mcap", rollout, tmp_path / "frames")
    actions = decode(tmp_path / "a.mcap")["/action"]
    labels = build_frame_table(rollout, make_frames(rollout), 4).columns["action.discrete"]
    assert [action["id"] for _, action in actions] == np.ravel(labels).tolist()
    assert [at for at, _ in actions] == [250_000_000 * k for k in range(13)]
    assert all(action["derived"] for _, action in actions)


def test_the_map_is_a_grid_under_the_feet(written: tuple[Path, Rollout, Path]) -> None:
    ((at, grid),) = decode(written[0])["/map"]
    assert at == 0 and grid.frame_id == "world"
    assert (grid.column_count, grid.row_stride, grid.cell_stride) == (3, 12, 4)
    assert [field.name for field in grid.fields] == ["red", "green", "blue", "alpha"]
    cells = np.frombuffer(grid.data, np.uint8).reshape(2, 3, 4)
    corner = grid.pose.position
    assert (corner.x, corner.y) == (1.0, 2.0) and corner.z == pytest.approx(0.08)
    assert cells[0, 0, 3] == 0 and cells[1, 2].tolist() == list(BLOCKED)
    assert (cells[[0, 0, 1, 1], [1, 2, 0, 1]] == FREE).all()


def test_the_body_hangs_on_the_base(written: tuple[Path, Rollout, Path]) -> None:
    topics = decode(written[0])
    ((_, body),) = topics["/robot"]
    frames = {entity.id: entity.frame_id for entity in body.entities}
    assert all(entity.frame_locked for entity in body.entities)
    assert body.entities[0].cubes[0].size.x == pytest.approx(0.3)
    bases = [at for at, _ in topics["/tf"]]
    assert [at for at, _ in topics["/robot/tf"]] == bases
    moved = {t.child_frame_id: t for t in topics["/robot/tf"][3][1].transforms}
    assert set(moved) == set(frames.values())
    assert {t.parent_frame_id for t in moved.values()} == {"base"}
    assert moved[frames["wheel"]].translation.z == pytest.approx(-0.1)


@pytest.mark.parametrize(("joints", "feet"), [(29, 2), (0, 0)])
def test_every_sensor_of_any_body_has_its_name_and_unit(
    tmp_path: Path, joints: int, feet: int
) -> None:
    rollout = with_body(make_rollout(1.0), joints, feet)
    write_frame_folder(tmp_path / "frames", rollout)
    write_episode_mcap(tmp_path / "a.mcap", rollout, tmp_path / "frames")
    topics = decode(tmp_path / "a.mcap")
    for k, (at, imu) in enumerate(topics["/imu"]):
        i = 5 * k
        assert at == round(rollout.time_s[i] * 1e9)
        assert [imu[f"specific_force_{c}_base_m_s2"] for c in "xyz"] == rollout.imu[i, :3].tolist()
        assert [imu[f"angular_rate_{c}_base_rad_s"] for c in "xyz"] == rollout.imu[i, 3:].tolist()
        names = [joint.name for joint in topics["/joint_states"][k][1].joints]
        assert tuple(names) == rollout.joint_names
        if feet:
            touching = dict(zip(rollout.foot_names, rollout.foot_contact[i].tolist(), strict=True))
            assert topics["/foot_contact"][k][1] == touching
    assert len(topics["/imu"]) == 21
    assert ("/foot_contact" in topics) == bool(feet)
    assert_same(rollout, read_rollout(tmp_path / "a.mcap"))


@pytest.mark.parametrize("rate", [1, 10, 50])
def test_each_frame_has_a_base_pose(tmp_path: Path, rate: int) -> None:
    rollout = make_rollout(1.0)
    write_frame_folder(tmp_path / "frames", rollout, rate)
    write_episode_mcap(tmp_path / "a.mcap", rollout, tmp_path / "frames")
    topics = decode(tmp_path / "a.mcap")
    images = [at for at, _ in topics["/camera/rgb"]]
    assert len(images) == rate + 1
    assert set(images) <= {at for at, _ in topics["/tf"]}


def test_the_layout_shows_only_what_exists(written: tuple[Path, Rollout, Path]) -> None:
    topics = decode(written[0])
    layout = json.loads(LAYOUT.read_text())
    shown: set[str] = set()

    def panels(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else panels(node["first"]) + panels(node["second"])

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
    for value in re.findall(r'"(/[a-z_/]+)([^"]*)"', json.dumps(layout["configById"])):
        shown.add(value[0])
        message = topics[value[0]][0][1]
        for name in re.findall(r"\.(\w+)", value[1]):
            assert name in message if isinstance(message, dict) else hasattr(message, name)
    assert {"/camera/rgb", "/camera/depth", "/plan", "/state", "/command", "/events"} <= shown


def cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


DAMAGES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no folder": (shutil.rmtree, "meta.json is missing"),
    "no poses": (lambda f: (f / "frames.npz").unlink(), "frames.npz is missing"),
    "half a meta": (lambda f: cut(f / "meta.json", 80), "damaged"),
    "no codec": (lambda f: (f / "meta.json").write_text(json.dumps(META | {"rgb": {}})), "damaged"),
    "short video": (
        lambda f: write_rgb_video(f / "rgb.mp4", make_images(3)[0], 4),
        r"rgb\.mp4: 3 frames",
    ),
    "cut video": (lambda f: cut(f / "depth.mp4", 5000), r"depth\.mp4"),
    "other rollout": (lambda f: None, "do not belong to this rollout"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_frames_are_named_and_nothing_is_left(tmp_path: Path, damage: str) -> None:
    folder, (change, reason) = tmp_path / "frames", DAMAGES[damage]
    write_frame_folder(folder, make_rollout(2.0))
    change(folder)
    rollout = make_rollout(1.0 if damage == "other rollout" else 2.0)
    with pytest.raises(FileFormatError, match=reason):
        write_episode_mcap(tmp_path / "out" / "a.mcap", rollout, folder)
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()) == []
