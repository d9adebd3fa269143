"""Depth unprojected as OpenCV, ROS and Foxglove do lies on the scene's mesh.

OpenCV's convention puts the centre of the first pixel at (0, 0): a pixel in column u and row v with
depth z is the point ((u − cx) z / fx, (v − cy) z / fy, z) of the optical frame.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from tests.formats.mcap.test_episode import decode, rotation
from tests.support.scenes.render_scenes import facing
from tests.support.walks import glide
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import quat_to_matrix, yaw_to_quat
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.internnav import layout
from vlnpe.formats.internnav.writer import SceneEpisode, write_scene
from vlnpe.formats.lerobot import assemble_dataset, write_episode_unit
from vlnpe.formats.mcap.episode import write_episode_mcap
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.vlnce.vocabulary import Vocabulary
from vlnpe.rendering.camera.rollout_views import render_rollout
from vlnpe.rendering.camera.views import make_view
from vlnpe.rendering.gl.probe import why_no_gl
from vlnpe.rendering.registry import make_renderer

FRAME = 3
Points = NDArray[np.float64]


def unproject(depth_m: NDArray, intrinsics: NDArray) -> Points:
    """Points (N, 3) [m] in the optical frame of the valid pixels of a depth image (H, W)."""
    v, u = np.nonzero(depth_m > 0)
    z = depth_m[v, u].astype(np.float64)
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    return np.stack([(u - cx) * z / fx, (v - cy) * z / fy, z], -1)


def distance_to_mesh(points_world_m: Points, bundle: SceneBundle) -> NDArray[np.float64]:
    """Distance (N,) [m] of each point to the nearest triangle."""
    import pyvista

    visual = bundle.visual()
    mesh = pyvista.PolyData.from_regular_faces(visual.vertices, visual.faces)
    found: Any = mesh.find_closest_cell(points_world_m, return_closest_point=True)
    nearest = found[1]
    return np.linalg.norm(nearest - points_world_m, axis=1)


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    # Slanted towards table and wall, so that a pixel's shift is seen as depth.
    return glide([[3.2, 1.4], [1.2, 2.4]], "h1")


@pytest.fixture(scope="module")
def frames(
    two_rooms: SceneBundle, rollout: Rollout, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    folder = tmp_path_factory.mktemp("pixels") / "frames"
    folder.mkdir()
    view = make_view("ego", "h1", width_px=96, height_px=64)
    render_rollout(two_rooms, make_renderer(two_rooms), rollout, view, folder, 4)
    return folder


@pytest.fixture(scope="module")
def unit(frames: Path, rollout: Rollout, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pixels") / "unit"
    write_episode_unit(folder, rollout, read_frame_folder(frames))
    return folder


def assert_on_the_scene(points_world_m: Points, bundle: SceneBundle) -> None:
    off = distance_to_mesh(points_world_m[::7], bundle)
    # The robot itself is in view; all else is quantised to some millimetres.
    assert np.median(off) < 0.001
    assert np.quantile(off, 0.9) < 0.003


def test_the_principal_point_is_the_middle_of_the_pixel_centres() -> None:
    intrinsics = CameraModel("any", 256, 192, 90.0).intrinsics
    np.testing.assert_allclose(intrinsics, [[128, 0, 127.5], [0, 128, 95.5], [0, 0, 1]])


def test_depth_of_mcap_lies_on_the_mesh(
    two_rooms: SceneBundle, frames: Path, rollout: Rollout, tmp_path: Path
) -> None:
    write_episode_mcap(tmp_path / "a.mcap", rollout, frames)
    topics = decode(tmp_path / "a.mcap")
    at, image = topics["/camera/depth"][FRAME]
    calibration = dict(topics["/camera/calibration"])[at]
    base, camera = (dict(topics[t])[at].transforms[0] for t in ("/tf", "/camera/tf"))
    depth = np.frombuffer(image.data, "<u2").reshape(image.height, image.width) / 1000
    points = unproject(depth, np.reshape(calibration.K, (3, 3)))
    np.testing.assert_array_equal(np.reshape(calibration.P, (3, 4))[:, :3].ravel(), calibration.K)
    for transform in (camera, base):
        shift = transform.translation
        points = points @ rotation(transform.rotation).T + [shift.x, shift.y, shift.z]
    assert_on_the_scene(points, two_rooms)


def test_depth_of_lerobot_lies_on_the_mesh(
    two_rooms: SceneBundle, unit: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    assemble_dataset([unit], tmp_path / "set", provenance={}, licence="mit", title="Rooms")
    dataset: Any = LeRobotDataset(
        "vlnpe/pixels", root=tmp_path / "set", depth_output_unit="m", video_backend="pyav"
    )
    (episode,) = pq.read_table(tmp_path / "set" / "meta" / "episodes").to_pylist()
    frame = dataset[FRAME]
    depth = frame["observation.images.depth"][0].numpy()
    points = unproject(depth, np.reshape(episode["camera_intrinsics"], (3, 3)))
    pose = frame["observation.camera_pose"].double().numpy()
    points = points @ quat_to_matrix(pose[3:]).T + pose[:3]
    turn = quat_to_matrix(yaw_to_quat(episode["start_frame_yaw_world_rad"]))
    points = points @ turn.T + episode["start_frame_origin_world_m"]
    assert_on_the_scene(points, two_rooms)


def test_depth_of_interndata_lies_on_the_mesh(
    two_rooms: SceneBundle, unit: Path, tmp_path: Path
) -> None:
    write_scene(tmp_path / "scene", [SceneEpisode(unit, ("Go.",))], Vocabulary.of(["Go."]))
    camera = json.loads((tmp_path / "scene" / layout.INFO_PATH).read_text())["camera"]
    assert camera["pixel_convention"] == "opencv" and camera["hfov_deg"] == 90.0
    names = {"episode_chunk": 0, "episode_index": 0}
    row = pq.read_table(tmp_path / "scene" / layout.DATA_PATH.format(**names)).to_pylist()[FRAME]
    video = layout.VIDEO_PATH.format(video_key=layout.DEPTH_KEY, **names)
    stored = np.load(tmp_path / "scene" / video)[FRAME]
    depth = np.where(stored < 1, stored * layout.DEPTH_UNIT_M, 0)
    points = unproject(depth, np.array(camera["intrinsics"]))
    # The layout's camera frame looks along x, z up.
    points = points[:, [2, 0, 1]] * [1, -1, -1]
    turn = quat_to_matrix(row["observation.camera_orientation"])
    assert_on_the_scene(points @ turn.T + row["observation.camera_position"], two_rooms)


@pytest.mark.parametrize("kind", ["embree", "gl"])
def test_both_renderers_keep_the_convention(two_rooms: SceneBundle, kind: str) -> None:
    if kind == "gl" and (reason := why_no_gl()):
        pytest.skip(f"no OpenGL: {reason}")
    camera = CameraModel("pixels", 96, 64, 90.0)
    eye, quat = np.array([3.2, 1.4, 1.5]), facing(2.7, 0.3)
    _, depth = make_renderer(two_rooms, kind).render(camera, eye, quat)
    points = unproject(depth, camera.intrinsics) @ quat_to_matrix(quat).T + eye
    off = distance_to_mesh(points, two_rooms)
    assert np.median(off) < 1e-4 and np.quantile(off, 0.9) < 1e-3
