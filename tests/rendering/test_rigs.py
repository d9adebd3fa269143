"""Rigs: cameras at a height above the standing floor, on robots that really walk."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.collectors.test_replay import make_episode
from tests.support.walks import glide
from vlnpe.collectors.replay.replay import ReplayConfig, replay_in
from vlnpe.collectors.replay.world import open_world
from vlnpe.collectors.robots import get_robot
from vlnpe.evaluation.observation import Eye
from vlnpe.formats.core.arrays import Array
from vlnpe.formats.core.errors import InputError
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.video.mp4 import read_depth_video
from vlnpe.rendering.camera.rigs import parse_rigs, without_rig
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.camera.rollout_views import render_rollout
from vlnpe.rendering.camera.views import CameraOverrides, View, make_view, parse_views
from vlnpe.rendering.frame import ROBOT
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.registry import make_renderer

pytestmark = pytest.mark.chain

# How far the posture of a standing robot is from its default pose.
LEAN_DEG = {"aliengo": 1.5, "h1": 4.0, "vlnce": 1e-6}


@pytest.fixture(scope="module")
def renderer(two_rooms: SceneBundle) -> Renderer:
    return make_renderer(two_rooms)


@pytest.fixture(scope="module", params=LEAN_DEG)
def walk(two_rooms: SceneBundle, request: pytest.FixtureRequest) -> Rollout:
    robot = get_robot(request.param)
    controller = "path" if robot.joints else "flash"
    episode = make_episode(two_rooms, (1.0, 1.0), (2.6, 1.2))
    config = ReplayConfig(robot=robot.name, controller=controller)
    return replay_in(open_world(two_rooms, 0, robot), episode, config)


def views(cameras: str, robot: str, **mounting: float) -> list[View]:
    overrides = CameraOverrides(**mounting)  # type: ignore[arg-type]
    return parse_views(cameras, robot, overrides, light="baked", renderer="embree")


def attitude(quat: Array) -> Array:
    """Pitch down and roll (N, 2) [deg] of optical frames."""
    rotation = quat_to_matrix(quat)
    return np.rad2deg(np.arcsin(np.stack([-rotation[:, 2, 2], rotation[:, 2, 0]], axis=1)))


def seen_floor(view: View, depth_m: Array) -> tuple[float, Array]:
    """Height [m], and pitch down and roll [deg], of a camera from the floor in its depth alone."""
    rays = view.camera.pixel_rays()
    assert view.rig is not None
    down = np.rad2deg(np.arctan(rays[..., 1])) + view.rig.pitch_down_deg
    floor = (down > 38) & (down < 75) & (np.abs(rays[..., 0]) < 0.3)
    points = (rays * depth_m[..., None])[floor]
    plane = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0]
    height = 1 / np.linalg.norm(plane)
    assert np.abs(points @ (height * plane) - height).max() < 0.03  # a plane, nothing before it
    return float(height), np.rad2deg(np.arcsin((height * plane)[[2, 0]])) * (1, -1)


@pytest.mark.parametrize("name", ["rig:n1:96x96", "rig:navdp:96x96"])
def test_rigs_are_where_their_names_say(
    two_rooms: SceneBundle, renderer: Renderer, walk: Rollout, name: str, tmp_path: Path
) -> None:
    """By the extrinsics and by the floor in the depth image, while the robot stands and walks."""
    for view in views(name, walk.robot):
        assert view.rig is not None
        out = tmp_path / view.name
        render_rollout(two_rooms, renderer, walk, view, out)
        frames = read_frame_folder(out)
        position, quat = (
            frames.arrays[f"camera_{key}"] for key in ("position_world_m", "quat_wxyz")
        )
        tilt = attitude(quat)
        lean = LEAN_DEG[walk.robot]
        assert position[0, 2] == pytest.approx(view.rig.height_m, abs=0.02)
        assert tilt[0] == pytest.approx((view.rig.pitch_down_deg, 0.0), abs=lean)
        assert np.median(position[:, 2]) == pytest.approx(view.rig.height_m, abs=0.04)
        assert frames.camera.name == view.rig.name and view.camera.hfov_deg == 90.0
        depth = read_depth_video(frames.depth_video, frames.depth_range)
        for number in (0, len(depth) // 3):
            height, angles = seen_floor(view, depth[number])
            assert height == pytest.approx(position[number, 2], abs=0.01)
            assert angles == pytest.approx(tilt[number], abs=0.5)


def test_a_level_rig_stays_level_while_the_body_sways(renderer: Renderer, walk: Rollout) -> None:
    samples = walk.frame_samples(20)
    swaying, level = (
        RolloutFrames.plan(renderer, walk, view, samples).path
        for view in views("rig:125cm_30deg,rig:125cm_30deg:level", walk.robot)
    )
    np.testing.assert_allclose(attitude(level.quat_wxyz), [[30.0, 0.0]] * len(samples), atol=1e-6)
    moved = np.ptp(attitude(swaying.quat_wxyz), axis=0)
    assert (moved > 0.3).all() == bool(walk.joint_names)
    away = np.linalg.norm(swaying.position_world_m - level.position_world_m, axis=1)
    assert away.max() < 0.2
    # It turns with the robot.
    heading = quat_to_matrix(walk.quat_wxyz[samples])[:, :2, 0]
    ahead = quat_to_matrix(level.quat_wxyz)[:, :2, 2]
    aligned = np.einsum("ni,ni->n", heading, ahead) / np.prod(
        [np.linalg.norm(x, axis=1) for x in (heading, ahead)], axis=0
    )
    assert aligned.min() > np.cos(np.deg2rad(0.5))


@pytest.mark.parametrize("rig", ["rig:125cm_30deg", "rig:60cm_15deg:level"])
def test_a_policy_sees_what_is_recorded(
    two_rooms: SceneBundle, renderer: Renderer, rig: str
) -> None:
    world = open_world(two_rooms, 0, get_robot("aliengo"))
    walk = replay_in(world, make_episode(two_rooms, (1.0, 1.0), (1.6, 1.2)), ReplayConfig())
    (view,) = views(f"{rig}:64x64", "aliengo")
    last = np.array([len(walk.time_s) - 1])
    # The robot was watched for some seconds after the record's end.
    handles, qpos = world.handles, world.data.qpos
    pose = walk.position_world_m[-1], walk.quat_wxyz[-1]
    qpos[handles.root_qpos : handles.root_qpos + 7] = np.concatenate(pose)
    qpos[handles.joint_qpos] = walk.joint_position_rad[-1]
    mujoco.mj_forward(world.model, world.data)
    recorded = next(RolloutFrames.plan(renderer, walk, view, last).render(renderer))
    seen = Eye(world, view, renderer).look()
    np.testing.assert_allclose(seen[1], recorded[1], atol=0.01)


@pytest.mark.parametrize("robot", ["h1", "jetbot", "aliengo"])
def test_no_rig_sees_the_robot_that_carries_it(renderer: Renderer, robot: str) -> None:
    """Not even one in the middle of its body, or above it looking down."""
    standing = glide([[2.0, 2.0], [2.2, 2.0]], robot)
    first = np.array([0])

    def sees_itself(view: View) -> bool:
        (frame,) = RolloutFrames.plan(renderer, standing, view, first).render_labelled(renderer)
        return bool((frame.label == ROBOT).any())

    cameras = "rig:125cm_45deg:64x64,rig:60cm_30deg:64x64,rig:30cm_0deg:64x64,rig:200cm_80deg:64x64"
    assert not any(map(sees_itself, views(cameras, robot)))
    assert sees_itself(make_view("chase", robot, width_px=64, height_px=64))


def test_a_height_or_a_pitch_alone_is_a_rig_with_the_robots_own_other_value() -> None:
    own = {
        "h1": ("rig:160cm_15deg", "rig:165.7cm_40deg"),
        "vlnce": ("rig:160cm_0deg", "rig:125cm_40deg"),
    }
    for robot, (higher, tilted) in own.items():
        (view,) = views("ego:64x64", robot, height_m=1.6)
        assert view == views(f"{higher}:64x64", robot)[0]
        (view,) = views("ego", robot, pitch_down_deg=40.0)
        assert view == views(tilted, robot)[0]
    ego, top = views("ego,top", "h1", height_m=1.25, pitch_down_deg=30.0)
    assert (ego.camera.name, top.rig) == ("rig:125cm_30deg", None)


def test_rigs_have_names_sizes_and_fields_of_view() -> None:
    names = [view.name for view in views("ego,rig:n1:96x64:79,rig:80.5cm_-10deg:level:60", "h1")]
    assert names == [
        "ego-256x256-90deg-baked",
        "rig-125cm_0deg-96x64-79deg-baked",
        "rig-125cm_30deg-96x64-79deg-baked",
        "rig-125cm_45deg-96x64-79deg-baked",
        "rig-60cm_15deg-96x64-79deg-baked",
        "rig-60cm_30deg-96x64-79deg-baked",
        "rig-80.5cm_-10deg-level-256x256-60deg-baked",
    ]
    assert len({without_rig(name) for name in names}) == 3
    for name in ("rig:5cm_-90deg", "rig:300cm_90deg:level", "rig:110.5cm_0deg"):
        assert parse_rigs(name)[0].name == name


@pytest.mark.parametrize(
    ("cameras", "reason"),
    [
        ("rig:n2", "unknown camera 'rig:n2' .*valid: rig:125cm_30deg, rig:n1, rig:navdp"),
        ("rig", "valid: rig:125cm_30deg, rig:n1, rig:navdp"),
        ("rig:125cm", "unknown camera 'rig:125cm'"),
        ("rig:640x480", "unknown camera 'rig:640x480'"),
        ("rig:300.1cm_0deg", "camera height 300.1 cm; valid: 5 to 300 cm"),
        ("rig:4cm_0deg", "camera height 4 cm; valid: 5 to 300 cm"),
        ("rig:125cm_91deg", "camera pitch 91° down; valid: -90 to 90° down"),
        ("rig:125cm_0deg:upright", "valid: KIND"),
        ("rig:n1,rig:60cm_15deg", "twice"),
        ("rig:n1:33x32", "valid: even sides"),
    ],
)
def test_rigs_that_cannot_be_are_named(cameras: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        views(cameras, "aliengo")


@pytest.mark.parametrize(
    ("cameras", "mounting", "reason"),
    [
        ("ego", {"height_m": 9.0}, "camera height 900 cm; valid: 5 to 300 cm"),
        ("ego", {"pitch_down_deg": 120.0}, "camera pitch 120° down"),
        ("chase,rig:n1", {"height_m": 1.0}, "not moved by a height or pitch; valid: ego"),
    ],
)
def test_a_camera_that_cannot_be_moved_so_is_named(
    cameras: str, mounting: dict[str, float], reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        views(cameras, "aliengo", **mounting)
