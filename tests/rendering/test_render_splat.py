"""The renderer of scenes of splats, in the two-room scene with splats on all its surfaces."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.scenes.rooms import write_two_rooms
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.errors import FileFormatError, InputError
from vlnpe.formats.core.frames import matrix_to_quat
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
from vlnpe.formats.splats.harmonics import C0
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.formats.splats.store import SPLATS_NAME, load_splats, save_splats
from vlnpe.rendering.registry import make_renderer, scene_renderer_name
from vlnpe.rendering.scene.robot_body import RobotBody

pytestmark = pytest.mark.chain

CAMERA = CameraModel("test", 96, 64, 80.0)
EAST = matrix_to_quat(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
SPACING_M = 0.06


def splats_on(bundle: SceneBundle, rng: np.random.Generator) -> GaussianCloud:
    """Return flat Gaussians on the bundle's triangles, in the colour of the side they face."""
    mesh = bundle.visual()
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(cross, axis=1)
    corners, cross, area = corners[area > 0], cross[area > 0], area[area > 0]
    face = np.repeat(np.arange(len(area)), np.ceil(3 * area / SPACING_M**2).astype(int))
    u, v = rng.random((2, len(face)))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = corners[face].swapaxes(0, 1)
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    normal = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    across = corners[:, 1] - corners[:, 0]
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axes = np.stack([across, np.cross(normal, across), normal], axis=2)
    color = 0.2 + 0.6 * np.abs(normal[face])
    return GaussianCloud(
        position=points.astype(np.float32),
        scale=np.tile(np.array([SPACING_M, SPACING_M, 0.002], np.float32), (len(face), 1)),
        quat_wxyz=matrix_to_quat(axes)[face].astype(np.float32),
        opacity=np.full(len(face), 0.9, dtype=np.float32),
        harmonics=((color[:, None] - 0.5) / C0).astype(np.float32),
    )


@pytest.fixture(scope="module")
def splat_rooms(tmp_path_factory: pytest.TempPathFactory) -> SceneBundle:
    folder = tmp_path_factory.mktemp("splats") / "rooms"
    bundle = write_two_rooms(folder)
    save_splats(folder, splats_on(bundle, np.random.default_rng(0)))
    return load_bundle(folder)


def test_splats_are_stored_to_16_bits(splat_rooms: SceneBundle) -> None:
    cloud = splats_on(splat_rooms, np.random.default_rng(0))
    stored = load_splats(splat_rooms.root)
    assert np.array_equal(stored.position, cloud.position)
    assert np.allclose(stored.scale, cloud.scale, rtol=0.005)
    assert np.allclose(stored.quat_wxyz, cloud.quat_wxyz, atol=1e-4)
    assert np.allclose(stored.opacity, cloud.opacity, atol=1e-4)
    assert np.allclose(stored.harmonics, cloud.harmonics, atol=2e-3)


def test_colour_is_of_splats_and_depth_of_the_mesh(splat_rooms: SceneBundle) -> None:
    renderer = make_renderer(splat_rooms, "splat")
    plain = make_renderer(splat_rooms, "embree")
    rgb, depth = renderer.render(CAMERA, [5.0, 2.0, 1.2], EAST)
    _, true = plain.render(CAMERA, [5.0, 2.0, 1.2], EAST)
    assert np.array_equal(depth, true)
    # The far wall faces x: red; the floor faces z: blue.
    assert rgb[20, 48] == pytest.approx([204, 51, 51], abs=12)
    assert rgb[60, 10] == pytest.approx([51, 51, 204], abs=12)
    labels = renderer.render_labelled(CAMERA, [5.0, 2.0, 1.2], EAST)
    assert np.array_equal(labels.label, plain.render_labelled(CAMERA, [5.0, 2, 1.2], EAST).label)


def test_the_robot_stands_before_splats_and_behind_them(splat_rooms: SceneBundle) -> None:
    robot = get_robot("aliengo")
    body = RobotBody(robot.build_model(floor=False), [joint.name for joint in robot.joints])
    pose = [joint.default_rad for joint in robot.joints]
    renderer, plain = make_renderer(splat_rooms, "splat"), make_renderer(splat_rooms, "embree")

    def both(x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = body.pose(np.array([x, 2.0, robot.base_height_m]), np.array([1.0, 0, 0, 0]), pose)
        frame = renderer.render_labelled(CAMERA, [4.5, 2.0, 0.8], EAST, at)
        other = plain.render_labelled(CAMERA, [4.5, 2.0, 0.8], EAST, at)
        assert np.array_equal(frame.depth_m, other.depth_m)
        assert np.array_equal(frame.label, other.label)
        return frame.rgb.astype(int), other.rgb.astype(int), other.label == -2

    rgb, true, robot_px = both(6.0)
    assert robot_px.sum() > 150
    inner = robot_px & np.roll(robot_px, 1, 0) & np.roll(robot_px, -1, 0) & np.roll(robot_px, 1, 1)
    assert np.median(np.abs(rgb - true)[inner]) < 3
    empty, _ = renderer.render(CAMERA, [4.5, 2.0, 0.8], EAST)
    dark = empty.astype(int).sum(2) - rgb.sum(2)
    assert (dark[~robot_px] > 20).sum() > 20, "no shadow on the floor"
    hidden, _, robot_px = both(9.5)  # behind the eastern wall
    assert not robot_px.any()
    assert np.abs(hidden - empty.astype(int)).max() <= 1


def test_depth_is_that_of_the_splats_if_wanted(splat_rooms: SceneBundle, tmp_path: Path) -> None:
    """Splats moved off the mesh tell the two depths apart; the robot is composed in by depth."""
    shutil.copytree(splat_rooms.root, tmp_path / "rooms")
    cloud = load_splats(tmp_path / "rooms")
    east = (cloud.position[:, 0] > 7.8) & (cloud.position[:, 2] > 0.2) & (cloud.position[:, 2] < 2)
    moved = cloud.position.copy()
    moved[east, 0] -= 0.3
    save_splats(tmp_path / "rooms", replace(cloud, position=moved))
    bundle = load_bundle(tmp_path / "rooms")
    mesh, splats = make_renderer(bundle, "splat"), make_renderer(bundle, "splat_depth")
    assert (mesh.name, splats.name) == ("splat", "splat_depth")
    camera, at = CAMERA, [5.0, 2.0, 1.2]
    rgb, near = splats.render(camera, at, EAST)
    plain, far = mesh.render(camera, at, EAST)
    assert np.array_equal(rgb, plain)
    assert np.median((far - near)[24:36, 30:66]) == pytest.approx(0.3, abs=0.02)
    # Elsewhere both are the same surface.
    assert np.median(np.abs(far - near)[58:]) < 0.03
    robot = get_robot("aliengo")
    body = RobotBody(robot.build_model(floor=False), [joint.name for joint in robot.joints])
    pose = [joint.default_rad for joint in robot.joints]
    at_robot = body.pose(np.array([6.5, 2.0, robot.base_height_m]), np.array([1.0, 0, 0, 0]), pose)
    frame = splats.render_labelled(camera, [5.0, 2.0, 0.8], EAST, at_robot)
    true = mesh.render_labelled(camera, [5.0, 2.0, 0.8], EAST, at_robot)
    on_robot = frame.label == -2
    assert on_robot.sum() > 100
    assert np.median(np.abs(frame.depth_m - true.depth_m)[on_robot]) < 0.01


def test_pixels_without_splats_show_the_mesh(splat_rooms: SceneBundle, tmp_path: Path) -> None:
    shutil.copytree(splat_rooms.root, tmp_path / "rooms")
    cloud = load_splats(tmp_path / "rooms")
    save_splats(tmp_path / "rooms", cloud.take(cloud.position[:, 2] > 0.05))
    renderer = make_renderer(load_bundle(tmp_path / "rooms"), "splat")
    floor = renderer.render(CAMERA, [1.0, 2.0, 1.2], EAST)[0][62, 20:60]
    true = make_renderer(splat_rooms, "embree").render(CAMERA, [1.0, 2.0, 1.2], EAST)[0]
    assert np.median(np.abs(floor.astype(int) - true[62, 20:60])) < 6


def test_missing_requirements_of_the_renderer_are_named(
    splat_rooms: SceneBundle, two_rooms: SceneBundle
) -> None:
    with pytest.raises(InputError, match="baked"):
        make_renderer(splat_rooms, "splat", light="DL300")
    for name in ("splat", "splat_depth"):
        with pytest.raises(
            InputError, match=f"renderer {name}.*no Gaussian splats; valid: embree, gl"
        ):
            make_renderer(two_rooms, name)
    assert scene_renderer_name(splat_rooms.root) == "splat"
    assert scene_renderer_name(splat_rooms.root, "embree") == "embree"
    assert scene_renderer_name(two_rooms.root) in ("embree", "gl")


def test_damaged_splats_are_named(splat_rooms: SceneBundle, tmp_path: Path) -> None:
    data = (splat_rooms.root / SPLATS_NAME).read_bytes()
    (tmp_path / SPLATS_NAME).write_bytes(data[: len(data) // 2])
    with pytest.raises(FileFormatError, match="damaged"):
        load_splats(tmp_path)
    with pytest.raises(FileFormatError, match="no Gaussian splats"):
        load_splats(tmp_path / "nothing")
