"""The two renderers show the same; lights change colours alone."""

from pathlib import Path

import numpy as np
import pytest

from tests.support.scenes.render_scenes import ball_robot, facing, write_covered_floor, write_wall
from vlnpe.formats.core.camera import CameraModel
from vlnpe.formats.core.errors import InputError, UnknownNameError
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.rendering import registry
from vlnpe.rendering.frame import NOTHING, ROBOT
from vlnpe.rendering.gl import draw as gl_draw
from vlnpe.rendering.gl.probe import why_no_gl
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.light.lights import LIGHTS
from vlnpe.rendering.registry import chosen_renderer, make_renderer
from vlnpe.rendering.scene.robot_body import RobotBody

pytestmark = pytest.mark.chain

CAMERA = CameraModel("test", 128, 96, 90.0)
VIEWS = [
    ([1.0, 2.0, 0.45], facing(0.0)),
    ([5.2, 3.2, 1.4], facing(-0.8, 0.3)),
    ([3.0, 2.0, 0.6], facing(0.1, 0.1)),
]


@pytest.fixture(scope="module")
def needs_gl() -> None:
    if reason := why_no_gl():
        pytest.skip(f"no OpenGL: {reason}")


@pytest.fixture(scope="module")
def embree(two_rooms: SceneBundle) -> dict[str, Renderer]:
    return {light: make_renderer(two_rooms, "embree", light=light) for light in LIGHTS}


@pytest.fixture(scope="module")
def ball() -> RobotBody:
    return RobotBody(ball_robot(), ["hinge"])


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return float(10 * np.log10(255.0**2 / max(np.mean((a.astype(float) - b) ** 2), 1e-9)))


@pytest.mark.parametrize("light", sorted(LIGHTS))
def test_both_renderers_show_the_same(
    needs_gl: None, two_rooms: SceneBundle, embree: dict[str, Renderer], ball: RobotBody, light: str
) -> None:
    drawn = make_renderer(two_rooms, "gl", light=light)
    for eye, quat in VIEWS:
        pose = ball.pose([2.5, 2.2, 0.5], [1.0, 0.0, 0.0, 0.0], [0.0])
        lamp = ([2.0, 1.0, 0.5], facing(0.3))
        for robot, cut, lamp_pose in (
            (pose, np.inf, None),
            (None, 2.0, None),
            (None, np.inf, lamp),
        ):
            rgb, depth = drawn.render(CAMERA, eye, quat, robot, cut, lamp_pose)
            other, truth = embree[light].render(CAMERA, eye, quat, robot, cut, lamp_pose)
            assert (np.abs(depth - truth) < 2e-3).mean() > 0.99
            assert psnr(rgb, other) > 30.0
    again = drawn.render(CAMERA, *VIEWS[0])
    assert np.array_equal(again[0], drawn.render(CAMERA, *VIEWS[0])[0])


def test_both_renderers_cut_the_scene_above(
    needs_gl: None, two_rooms: SceneBundle, embree: dict[str, Renderer]
) -> None:
    down, eye = facing(0.0, np.pi / 2), [1.5, 2.5, 6.0]
    drawn = make_renderer(two_rooms, "gl")
    for cut in (0.5, 2.0, np.inf):
        rgb, depth = drawn.render(CAMERA, eye, down, None, cut)
        other, truth = embree["baked"].render(CAMERA, eye, down, None, cut)
        assert (np.abs(depth - truth) < 2e-3).mean() > 0.99
        assert psnr(rgb, other) > 30.0


def test_a_scan_under_a_cut_off_ceiling_keeps_its_colours(needs_gl: None, tmp_path: Path) -> None:
    # The floor is shown as it is, the ceiling would be lit: the cut has to take it off in both.
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    image[8:56, 8:56] = (200, 120, 40)
    bundle = write_covered_floor(tmp_path, image)
    view = [-2.2, 0.0, 4.0], facing(0.0, 1.05)  # oblique: from above, light changes little
    camera = CameraModel("narrow", 64, 64, 15.0)
    for name in ("embree", "gl"):
        renderer = make_renderer(bundle, name)
        rgb, depth = renderer.render(camera, *view, None, 1.5)
        assert abs(depth[32, 32] - 4.0 / np.sin(1.05)) < 0.05
        assert (np.abs(rgb.astype(int) - image[32, 32]) <= 1).all()
        rgb, depth = renderer.render(camera, *view)
        assert abs(depth[32, 32] - 2.0 / np.sin(1.05)) < 0.05
        assert np.ptp(rgb.reshape(-1, 3).mean(0)) < 3  # the ceiling's grey


def test_both_renderers_name_the_same_things(
    needs_gl: None, two_rooms: SceneBundle, embree: dict[str, Renderer], ball: RobotBody
) -> None:
    drawn = make_renderer(two_rooms, "gl")
    pose = ball.pose([2.5, 2.0, 0.5], [1.0, 0.0, 0.0, 0.0], [0.0])
    a, b = (r.render_labelled(CAMERA, *VIEWS[0], pose) for r in (embree["baked"], drawn))
    assert (a.label == b.label).mean() > 0.99
    assert (a.thing == b.thing).mean() > 0.99


def test_labels_are_those_of_what_is_seen(
    two_rooms: SceneBundle, embree: dict[str, Renderer], ball: RobotBody
) -> None:
    pose = ball.pose([2.5, 2.0, 0.45], [1.0, 0.0, 0.0, 0.0], [0.0])
    frame = embree["baked"].render_labelled(CAMERA, [1.0, 2.0, 0.45], facing(0.0), pose)
    assert frame.label[48, 64] == ROBOT
    assert frame.thing[48, 64] == ROBOT
    assert two_rooms.labels[frame.label[90, 64]] == "floor"
    assert two_rooms.labels[frame.label[40, 5]] == "wall"
    assert frame.label[0, 64] == NOTHING or two_rooms.labels[frame.label[0, 64]] == "wall"
    assert ((frame.label == NOTHING) == (frame.depth_m == 0)).all()
    rgb, depth = embree["baked"].render(CAMERA, [1.0, 2.0, 0.45], facing(0.0), pose)
    assert np.array_equal(rgb, frame.rgb)
    assert np.array_equal(depth, frame.depth_m)


def test_light_changes_colours_and_never_depth(embree: dict[str, Renderer]) -> None:
    for eye, quat in VIEWS:
        frames = {light: r.render(CAMERA, eye, quat) for light, r in embree.items()}
        for rgb, depth in frames.values():
            assert np.array_equal(depth, frames["baked"][1])
            assert (rgb.max(-1) >= 254).mean() < 0.05  # not blown out
        seen = frames["baked"][1] > 0
        mean = {light: rgb[seen].mean() for light, (rgb, _) in frames.items()}
        assert mean["DL5000"] > 1.5 * mean["DL300"] > 15.0  # day, night, but not black


def test_the_robots_lamp_lights_what_is_ahead(embree: dict[str, Renderer]) -> None:
    rgb, _ = embree["CL"].render(
        CameraModel("wide", 240, 60, 140.0), [2.0, 1.2, 1.0], facing(np.pi)
    )
    row = rgb[30].mean(-1)
    assert row[100:140].mean() > 3 * row[:25].mean()
    assert row[100:140].mean() > 3 * row[-25:].mean()


def test_the_lamp_does_not_shine_through_walls(embree: dict[str, Renderer]) -> None:
    eye, quat = [6.0, 0.6, 1.5], facing(np.pi / 2, 0.6)  # in the room behind the wall x = 4
    near, _ = embree["CL"].render(CAMERA, eye, quat, lamp_pose=([3.0, 3.4, 1.0], facing(0.0)))
    there, _ = embree["CL"].render(CAMERA, eye, quat, lamp_pose=([5.0, 3.0, 1.0], facing(0.0)))
    assert near.max() < 60
    assert there.max() > 100


def test_scans_keep_their_colours_in_both(needs_gl: None, tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    image[16:48, 16:48] = (200, 120, 40)
    bundle = write_wall(tmp_path, image)
    for name in ("embree", "gl"):
        rgb, _ = make_renderer(bundle, name).render(CAMERA, [1.0, 0.0, 1.0], facing(0.0))
        assert np.abs(rgb[40:56, 50:78].astype(int) - image[32, 32]).max() <= 1


def test_a_slow_pan_over_a_fine_floor_does_not_shimmer(two_rooms: SceneBundle) -> None:
    """Against 4 × 4 samples a pixel: the error hardly changes from frame to frame."""
    renderer = make_renderer(two_rooms)
    fine = CameraModel("fine", 4 * CAMERA.width_px, 4 * CAMERA.height_px, CAMERA.hfov_deg)
    errors = []
    for k in range(4):
        eye, quat = [0.6, 1.0 + 0.004 * k, 0.45], facing(0.4 + 0.004 * k, 0.2)
        rgb, _ = renderer.render(CAMERA, eye, quat)
        truth, _ = renderer.render(fine, eye, quat)
        blocks = truth.reshape(CAMERA.height_px, 4, CAMERA.width_px, 4, 3).mean((1, 3))
        errors.append(rgb - blocks)
    lower = np.array(errors)[:, 60:]  # the floor
    assert np.abs(np.diff(lower, axis=0)).mean() < 1.5
    assert np.abs(lower).mean() < 3.0


def test_auto_falls_to_embree_without_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "graphics_card", lambda: "")
    assert chosen_renderer("auto") == "embree"
    monkeypatch.setattr(registry, "graphics_card", lambda: "Some Card")
    assert chosen_renderer("auto") == "gl"
    monkeypatch.setattr(registry, "why_no_gl", lambda: "no EGL device")
    with pytest.raises(InputError, match="renderer gl: no EGL device; valid here: embree"):
        chosen_renderer("gl")
    with pytest.raises(UnknownNameError, match="valid: auto, embree, gl, splat"):
        chosen_renderer("vulkan")


def test_a_missing_driver_is_named(two_rooms: SceneBundle, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise OSError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(gl_draw, "open_display", broken)
    gl_draw.gl_context.cache_clear()
    with pytest.raises(InputError, match=r"renderer gl: .*libEGL\.so\.1.*embree"):
        make_renderer(two_rooms, "gl")
    gl_draw.gl_context.cache_clear()
