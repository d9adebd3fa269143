"""The robot's own body in the picture: shapes, poses, occlusion."""

import cv2
import mujoco
import numpy as np
import pytest

from tests.support.scenes.render_scenes import SQUARE, ball_robot, facing
from vlnpe.collectors.robots import ROBOTS, get_robot
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.frames import OPTICAL_IN_BODY, quat_to_matrix, yaw_to_quat
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.registry import make_renderer
from vlnpe.rendering.scene.primitives import geom_surface
from vlnpe.rendering.scene.robot_body import RobotBody

UPRIGHT = [1.0, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def renderer(two_rooms: SceneBundle) -> Renderer:
    return make_renderer(two_rooms)


@pytest.fixture(scope="module")
def ball() -> RobotBody:
    return RobotBody(ball_robot(), ["hinge"])


VOLUMES = {
    "sphere": ("0.3", 4 / 3 * np.pi * 0.3**3),
    "ellipsoid": ("0.3 0.2 0.1", 4 / 3 * np.pi * 0.3 * 0.2 * 0.1),
    "capsule": ("0.1 0.25", 4 / 3 * np.pi * 0.1**3 + np.pi * 0.1**2 * 0.5),
    "cylinder": ("0.1 0.25", np.pi * 0.1**2 * 0.5),
    "box": ("0.1 0.2 0.3", 8 * 0.1 * 0.2 * 0.3),
}


@pytest.mark.parametrize("shape", VOLUMES)
def test_primitives_are_closed_face_outwards_and_have_their_size(shape: str) -> None:
    size, volume = VOLUMES[shape]
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="{shape}" size="{size}"/></worldbody></mujoco>'
    )
    corners, normals = geom_surface(model, 0)
    # Divergence theorem: right only when closed and consistently wound.
    signed = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert signed == pytest.approx(volume, rel=0.06)
    assert signed <= volume * (1 + 1e-9)  # inscribed
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1.0)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fi,fki->fk", face, normals) > 0).all()
    extent = np.abs(corners).max((0, 1))
    expected = np.full(3, model.geom_rbound[0]) if shape == "sphere" else model.geom_aabb[0, 3:]
    assert np.allclose(extent, expected, rtol=0.02)


def test_a_shape_without_a_surface_is_refused() -> None:
    with pytest.raises(ValueError, match="mjGEOM_PLANE; valid: mesh and mjGEOM_BOX"):
        geom_surface(ball_robot(), 0)


def test_the_body_stands_before_the_wall_at_its_own_depth(
    renderer: Renderer, ball: RobotBody
) -> None:
    eye, quat = [5.0, 2.5, 1.3], facing(0.0)
    pose = ball.pose([6.5, 2.5, 1.3], UPRIGHT, [0.0])
    rgb, depth = renderer.render(SQUARE, eye, quat, pose)
    _, empty = renderer.render(SQUARE, eye, quat)
    assert depth[64, 64] == pytest.approx(1.3, abs=5e-3)  # facets
    assert rgb[64, 64, 0] > 100
    assert rgb[64, 64, 1] < 10
    robot = depth != empty
    radius_px = SQUARE.focal_px * 0.2 / np.sqrt(1.5**2 - 0.2**2)
    assert robot.sum() == pytest.approx(np.pi * radius_px**2, rel=0.06)
    assert (depth <= empty).all()


@pytest.mark.parametrize("size_px", [(128, 128), (320, 200)])
def test_a_drawing_for_a_reader_shows_what_it_would_find_in_the_whole_picture(
    renderer: Renderer, ball: RobotBody, size_px: tuple[int, int]
) -> None:
    camera, side = CameraModel("test", *size_px, 90.0), 48
    pose = ball.pose([6.5, 2.5, 1.3], UPRIGHT, [0.0])
    for yaw in np.linspace(0.0, 6.0, 7):
        shot = camera, [5.3, 2.4, 1.3], facing(yaw, 0.1), pose
        rgb, depth = renderer.render(*shot)
        small, picked = renderer.render_for(side, *shot)
        assert small.shape[0] * small.shape[1] < 0.6 * camera.width_px * camera.height_px
        nearest = cv2.resize(depth, (side, side), interpolation=cv2.INTER_NEAREST_EXACT)
        assert np.isclose(picked, nearest).mean() > 0.999  # rays along an edge may take either side
        whole, mean = (
            cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA).astype(float)
            for image in (rgb, small)
        )
        assert abs(mean - whole).mean() < 3.0


def test_a_reader_of_the_whole_picture_gets_it(renderer: Renderer) -> None:
    shot = SQUARE, [5.0, 2.5, 1.3], facing(0.0)
    for seen, whole in zip(renderer.render_for(100, *shot), renderer.render(*shot), strict=True):
        assert np.array_equal(seen, whole)


def test_the_body_behind_a_wall_is_not_seen(renderer: Renderer, ball: RobotBody) -> None:
    pose = ball.pose([5.0, 0.7, 1.0], UPRIGHT, [0.0])  # in the other room, behind the wall x = 4
    eye, quat = [2.0, 0.7, 1.0], facing(0.0)
    with_robot, without = (
        renderer.render(SQUARE, eye, quat, pose),
        renderer.render(SQUARE, eye, quat),
    )
    assert np.array_equal(with_robot[0], without[0])
    assert np.array_equal(with_robot[1], without[1])


def test_the_ground_and_collision_shapes_and_clear_geoms_are_no_body(ball: RobotBody) -> None:
    assert len(ball.surfaces) == 1
    assert np.allclose(ball.surfaces[0].color_linear, (1, 0, 0))


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.198, 0.0, 0.0)])
def test_a_camera_in_its_housing_is_not_blind(
    renderer: Renderer, ball: RobotBody, offset: tuple[float, float, float]
) -> None:
    eye = np.array([5.0, 2.5, 1.3])
    pose = ball.pose(eye - offset, UPRIGHT, [0.0])
    rgb, _ = renderer.render(SQUARE, eye, facing(0.0), pose)
    assert np.array_equal(rgb, renderer.render(SQUARE, eye, facing(0.0))[0])


def test_a_camera_that_touches_the_body_still_sees_it_beside(
    renderer: Renderer, ball: RobotBody
) -> None:
    eye = np.array([5.0, 2.5, 1.3])
    pose = ball.pose(eye - np.array([0.0, 0.0, 0.25]), UPRIGHT, [0.0])  # 5 cm under the lens
    _, depth = renderer.render(SQUARE, eye, facing(0.0), pose)
    _, empty = renderer.render(SQUARE, eye, facing(0.0))
    assert (depth[100:, 40:88] < empty[100:, 40:88]).any()


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_ego_camera_looks_forward_and_down_by_its_mount(name: str) -> None:
    robot = get_robot(name)
    body = RobotBody(robot.build_model(), robot.joint_names)
    yaw = 0.8
    position, quat = body.camera_pose(
        robot.camera.name,
        [1.0, 2.0, robot.base_height_m],
        yaw_to_quat(yaw),
        robot.default_joint_rad,
    )
    pitch = np.deg2rad(robot.camera.pitch_down_deg)
    rotation = quat_to_matrix(quat)
    forward = [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)]
    assert np.allclose(rotation[:, 2], forward, atol=1e-6)
    assert np.allclose(rotation[2, 0], 0.0, atol=1e-6)  # level horizon
    if robot.camera.body == robot.root_body:
        offset = quat_to_matrix(yaw_to_quat(yaw)) @ robot.camera.position_body_m
        assert np.allclose(position, np.array([1.0, 2.0, robot.base_height_m]) + offset, atol=1e-6)


def test_level_optical_axes() -> None:
    assert np.allclose(quat_to_matrix(facing(0.0)), OPTICAL_IN_BODY)


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_robots_do_not_block_their_own_view(renderer: Renderer, name: str) -> None:
    robot = get_robot(name)
    body = RobotBody(robot.build_model(), robot.joint_names)
    state = ([1.5, 2.0, robot.base_height_m], UPRIGHT, robot.default_joint_rad)
    eye, quat = body.camera_pose(robot.camera.name, *state)
    _, depth = renderer.render(robot.camera.model, eye, quat, body.pose(*state))
    _, empty = renderer.render(robot.camera.model, eye, quat)
    assert (depth != empty).mean() < 0.15


def test_joints_move_the_picture(renderer: Renderer) -> None:
    robot = get_robot("aliengo")
    body = RobotBody(robot.build_model(), robot.joint_names)
    base = ([2.5, 2.0, robot.base_height_m], UPRIGHT)
    bent = robot.default_joint_rad + 0.3
    frames = [
        renderer.render(SQUARE, [1.5, 2.0, 0.6], facing(0.0, 0.3), body.pose(*base, joints))[1]
        for joints in (robot.default_joint_rad, bent)
    ]
    assert (frames[0] != frames[1]).any()


def test_unknown_joints_are_named() -> None:
    with pytest.raises(
        ValueError, match=r"\['tail'\] are not in the model; valid: \['hinge', 'root'\]"
    ):
        RobotBody(ball_robot(), ["tail"])


def test_the_floor_is_darker_under_the_robot_and_nowhere_else(
    renderer: Renderer, ball: RobotBody
) -> None:
    eye, down = [2.0, 1.5, 2.4], facing(0.0, np.pi / 2)
    bare = renderer.render(SQUARE, eye, down)[0].astype(int)
    near = ball.pose([2.0, 1.5, 0.25], UPRIGHT, [0.0])
    rgb, depth = renderer.render(SQUARE, eye, down, near)
    floor = np.isclose(depth, 2.4, atol=1e-3)
    change = np.where(floor[..., None], bare - rgb, 0).max(-1)
    assert (change[floor] >= 0).all()
    assert change[64 - 9 : 64 + 9, 64 - 9 : 64 + 9].max() > 10  # around the ball's outline
    assert (change[:16] == 0).all()  # 2 m away


@pytest.mark.parametrize("pitch", [0.0, 0.7, 1.4])
@pytest.mark.parametrize("distance", [0.05, 0.21, 0.4, 1.0])
def test_parts_beside_and_behind_the_lens_are_drawn_where_they_are(
    renderer: Renderer, pitch: float, distance: float
) -> None:
    """A long bar that passes the camera: what is drawn must match the ray equation."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="base"><freejoint/>
        <geom type="box" size="1 0.02 0.02" mass="1"/></body></worldbody></mujoco>"""
    )
    eye = np.array([6.0, 2.5, 1.3])
    pose = RobotBody(model, []).pose(eye - np.array([0.0, 0.0, distance]), UPRIGHT, [])
    quat = facing(0.0, pitch)
    _, depth = renderer.render(SQUARE, eye, quat, pose)
    _, empty = renderer.render(SQUARE, eye, quat)
    rows, columns = np.indices(depth.shape, dtype=float)
    pixels = np.stack([columns, rows, np.ones_like(rows)], -1)
    rays = pixels @ np.linalg.inv(SQUARE.intrinsics).T @ quat_to_matrix(quat).T
    low = np.array([-1.0, -0.02, -distance - 0.02])
    high = np.array([1.0, 0.02, -distance + 0.02])
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = low / rays, high / rays
        near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    expected = np.where((near <= far) & (near > 0) & (near < empty), near, empty)
    assert (np.abs(depth - expected) > 1e-3).mean() < 2e-3


def test_the_outline_mixes_the_robot_with_what_is_behind_it(
    renderer: Renderer, ball: RobotBody
) -> None:
    """Not with itself: the triangle behind a robot's pixel is not seen there."""
    # No shadow: the ball hangs before a wall, which has one colour there.
    eye, quat = [5.0, 2.5, 1.3], facing(0.0)
    wall, far = (values.astype(float) for values in renderer.render(SQUARE, eye, quat))
    pose = ball.pose([6.5, 2.5, 1.3], UPRIGHT, [0.0])
    rgb, depth = (values.astype(float) for values in renderer.render(SQUARE, eye, quat, pose))
    # The share of the ball, in linear light (sRGB is near a power of 2.2): green is all wall's.
    share = 1 - ((rgb[..., 1] + 1e-9) / wall[..., 1]) ** 2.2
    robot = (depth < far).astype(np.uint8)
    inner = cv2.erode(robot, np.ones((3, 3))) > 0
    outline = (robot > 0) & ~inner
    assert share[cv2.erode(robot, np.ones((5, 5))) > 0].min() > 0.95
    assert (share[outline] < 0.85).mean() > 0.2
