"""Rollouts to videos, poses, pictures."""

import json
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from tests.support.scenes.rooms import PARTS
from tests.support.walks import glide
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.camera import DepthRange
from vlnpe.formats.core.errors import InputError, UnknownNameError
from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.core.rollout import Rollout
from vlnpe.formats.rendered.folder import read_frame_folder
from vlnpe.formats.rendered.table import build_frame_table
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.formats.video.depth_picture import FAR_M, SCALE_PX, depth_picture, depth_scale
from vlnpe.formats.video.id_video import read_id_video
from vlnpe.formats.video.mp4 import read_depth_video, read_rgb_video
from vlnpe.formats.video.stream import probe_video
from vlnpe.rendering.camera import rollout_views
from vlnpe.rendering.camera.extras import ROBOT_CODE, Extras
from vlnpe.rendering.camera.rollout_frames import RolloutFrames
from vlnpe.rendering.camera.rollout_views import render_rollout
from vlnpe.rendering.camera.views import (
    VIEWS,
    CameraOverrides,
    View,
    make_view,
    parse_views,
)
from vlnpe.rendering.figures.film_strip import film_strip
from vlnpe.rendering.figures.pictures import third_person_clip, watchable_video
from vlnpe.rendering.figures.scene_map import top_down_map
from vlnpe.rendering.interface import Renderer
from vlnpe.rendering.registry import make_renderer

pytestmark = pytest.mark.chain

LOWER = np.array([p[2] for p in PARTS])
UPPER = np.array([p[3] for p in PARTS])


@pytest.fixture(scope="module")
def renderer(two_rooms: SceneBundle) -> Renderer:
    return make_renderer(two_rooms)


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    return glide([[1.0, 1.0], [2.0, 2.0], [5.0, 2.0], [7.0, 3.0]])


@pytest.mark.parametrize("kind", sorted(VIEWS))
@pytest.mark.parametrize("rate", [4, 5])
def test_a_view_is_written_whole(
    two_rooms: SceneBundle,
    renderer: Renderer,
    rollout: Rollout,
    tmp_path: Path,
    kind: str,
    rate: int,
) -> None:
    view = make_view(kind, "aliengo", width_px=64, height_px=48)
    count = render_rollout(two_rooms, renderer, rollout, view, tmp_path, rate)
    samples = rollout.frame_samples(rate)
    assert count == len(samples)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "depth.mp4",
        "frames.npz",
        "meta.json",
        "rgb.mp4",
    ]
    rgb = read_rgb_video(tmp_path / "rgb.mp4")
    depth = read_depth_video(tmp_path / "depth.mp4", DepthRange())
    assert rgb.shape == (count, 48, 64, 3)
    assert depth.shape == (count, 48, 64)
    with np.load(tmp_path / "frames.npz") as frames:
        assert np.array_equal(frames["sample_index"], samples)
        assert np.allclose(frames["time_s"], np.arange(count) / rate)
        columns = build_frame_table(rollout, dict(frames), rate).columns
        assert columns["observation.camera_pose"].shape == (count, 7)
        # The stored pose and intrinsics reproduce the stored frame.
        exact_rgb, exact = renderer.render(
            view.camera,
            frames["camera_position_world_m"][3],
            frames["camera_quat_wxyz"][3],
            None,
            2.0 if kind == "top" else np.inf,
        )
    same = np.abs(depth[3] - exact) < 0.02  # log-quantised
    assert same.mean() > 0.85  # all but the robot itself
    assert np.abs(rgb[3].astype(int) - exact_rgb).mean() < 12
    meta = json.loads((tmp_path / "meta.json").read_text())
    assert (meta["frames"], meta["frames_per_second"], meta["light"]) == (count, rate, "baked")
    assert np.allclose(meta["camera"]["intrinsics"], view.camera.intrinsics)


def test_the_ego_camera_follows_the_robot(renderer: Renderer, rollout: Rollout) -> None:
    samples = rollout.frame_samples(4)
    view = make_view("ego", "aliengo")
    path = RolloutFrames.plan(renderer, rollout, view, samples).path
    distance = np.linalg.norm(path.position_world_m - rollout.position_world_m[samples], axis=1)
    mount = get_robot("aliengo").camera
    assert np.allclose(distance, np.linalg.norm(mount.position_body_m), atol=1e-6)
    forward = quat_to_matrix(path.quat_wxyz)[:, :, 2]
    heading = quat_to_matrix(rollout.quat_wxyz[samples])[:, :, 0]
    assert np.allclose(
        np.einsum("ni,ni->n", forward, heading), np.cos(np.deg2rad(mount.pitch_down_deg)), atol=1e-6
    )


def crossings(start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """(N,) whether the segment from start to stop meets any of the scene's boxes."""
    step = stop - start
    crossing = np.zeros(len(start), dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        for low, high in zip(LOWER, UPPER, strict=True):
            a, b = (low - start) / step, (high - start) / step
            near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            crossing |= (near <= far) & (near < 1) & (far > 0)
    return crossing


@pytest.mark.parametrize("seed", range(6))
def test_the_chase_camera_is_never_behind_a_wall(renderer: Renderer, seed: int) -> None:
    rng = np.random.default_rng(seed)
    door = np.array([[3.4, 2.0], [4.6, 2.0]])
    points = np.concatenate(
        [
            rng.uniform((0.5, 0.5), (3.2, 2.5), (3, 2)),
            door,
            rng.uniform((5, 1.4), (7.5, 3.5), (3, 2)),
        ]
    )
    walk = glide(points)
    samples = walk.frame_samples(5)
    path = RolloutFrames.plan(renderer, walk, make_view("chase", "aliengo"), samples).path
    base = walk.position_world_m[samples]
    pivot = base + np.array([0, 0, 0.35 * get_robot("aliengo").base_height_m])
    assert not crossings(pivot, path.position_world_m).any()
    assert (path.position_world_m[:, 2] > 0.05).all()
    assert np.linalg.norm(path.position_world_m - base, axis=1).max() < 2.5
    # It looks at the robot.
    local = np.einsum("nji,nj->ni", quat_to_matrix(path.quat_wxyz), base - path.position_world_m)
    assert (local[:, 2] > 0).all()
    assert (np.abs(local[:, :2] / local[:, 2:]) < 0.6).all()


def test_labels_and_millimetres_are_written_beside_the_videos(
    two_rooms: SceneBundle, renderer: Renderer, rollout: Rollout, tmp_path: Path
) -> None:
    view = make_view("chase", "aliengo", width_px=64, height_px=48)
    extras = Extras(semantic=True, instance=True, millimetres=True)
    count = render_rollout(two_rooms, renderer, rollout, view, tmp_path, 4, extras=extras)
    semantic, instance, millimetres = (
        read_id_video(tmp_path / f"{name}.mov") for name in ("semantic", "instance", "depth_mm")
    )
    assert semantic.shape == instance.shape == millimetres.shape == (count, 48, 64)
    names = json.loads((tmp_path / "labels.json").read_text())
    assert (semantic == ROBOT_CODE).any(axis=(1, 2)).all()  # followed by the camera
    assert np.array_equal(semantic == ROBOT_CODE, instance == ROBOT_CODE)
    assert set(np.unique(semantic).astype(str)) <= set(names["semantic"])
    assert {names["semantic"][str(k)] for k in np.unique(semantic)} >= {"floor", "wall", "robot"}
    depth = read_depth_video(tmp_path / "depth.mp4", DepthRange())
    assert np.abs(millimetres / 1000.0 - depth).max() < 0.006  # whole mm against 12-bit codes
    meta = json.loads((tmp_path / "meta.json").read_text())
    assert meta["semantic"]["file"] == "semantic.mov"


@pytest.mark.parametrize("light", ["DL300", "CL"])
def test_light_leaves_depth_and_poses_as_they_are(
    two_rooms: SceneBundle, renderer: Renderer, rollout: Rollout, tmp_path: Path, light: str
) -> None:
    lit = make_renderer(two_rooms, light=light)
    for source, folder in ((renderer, "a"), (lit, "b"), (lit, "c")):
        view = make_view("top", "aliengo", width_px=64, height_px=48, light=source.light)
        render_rollout(two_rooms, source, rollout, view, tmp_path / folder, 4)
    a, b, c = (tmp_path / folder for folder in "abc")
    with np.load(a / "frames.npz") as baked, np.load(b / "frames.npz") as other:
        for key in set(baked.files) - {"rgb_counts"}:
            np.testing.assert_array_equal(baked[key], other[key], err_msg=key)
    assert (a / "depth.mp4").read_bytes() == (b / "depth.mp4").read_bytes()
    seen = [read_rgb_video(folder / "rgb.mp4") for folder in (a, b, c)]
    assert np.array_equal(seen[1], seen[2])  # twice the same
    assert not np.array_equal(seen[0], seen[1])


def test_a_video_to_watch_plays_at_the_robots_pace(
    renderer: Renderer, rollout: Rollout, tmp_path: Path
) -> None:
    view = make_view("chase", "aliengo", width_px=64, height_px=48)
    parts: list[float] = []
    count = watchable_video(
        tmp_path / "walk.mp4", renderer, rollout, view, 10, on_part=parts.append
    )
    assert parts == [number / count for number in range(1, count + 1)]
    facts = probe_video(tmp_path / "walk.mp4")
    assert (facts.frames, facts.frames_per_second) == (count, 10)
    assert count == len(rollout.frame_samples(10))


def test_cameras_say_their_size_and_field_of_view() -> None:
    overrides = CameraOverrides(width_px=96)
    views = parse_views(
        "ego,chase:64x48,top:80x80:50", "aliengo", overrides, light="CL", renderer="gl"
    )
    assert [view.name for view in views] == [
        "ego-96x256-90deg-CL",
        "chase-64x48-75deg-CL",
        "top-80x80-50deg-CL",
    ]
    assert {view.renderer for view in views} == {"gl"}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("ego:33x32", "valid: even sides from 16"),
        ("ego:0x0", "valid: even sides"),
        ("ego:99999x64", "to 8192"),
        ("ego:64x64:179", "HFOV 179°; valid: 1 to 170"),
        ("ego:wide", "valid: KIND"),
        ("", "valid: KIND"),
        ("ego,ego", "twice"),
        ("drone", "valid: chase, ego, rig:125cm_30deg, rig:n1, rig:navdp, top"),
    ],
)
def test_unusable_cameras_are_refused(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        parse_views(text, "aliengo", CameraOverrides(), light="baked", renderer="embree")


def test_views_are_named_after_what_they_are() -> None:
    assert make_view("ego", "aliengo").name == "ego-256x256-90deg-baked"
    assert (
        make_view("chase", "aliengo", width_px=320, height_px=240, hfov_deg=60.0).name
        == "chase-320x240-60deg-baked"
    )


def test_wrong_names_and_rates_are_refused(
    two_rooms: SceneBundle, renderer: Renderer, rollout: Rollout, tmp_path: Path
) -> None:
    view = make_view("ego", "aliengo", width_px=64, height_px=48)
    out = tmp_path / "out"
    with pytest.raises(UnknownNameError, match="camera 'drone'; valid: chase, ego, top"):
        make_view("drone", "aliengo")
    with pytest.raises(UnknownNameError, match="valid: chase, ego, top"):
        render_rollout(two_rooms, renderer, rollout, View("drone", view.camera), out)
    with pytest.raises(UnknownNameError, match="video codec 'vp3'"):
        render_rollout(two_rooms, renderer, rollout, view, out, codec="vp3")
    with pytest.raises(ValueError, match="frame rate 3 does not divide 100"):
        render_rollout(two_rooms, renderer, rollout, view, out, 3)
    with pytest.raises(ValueError, match="light night, not embree with baked"):
        render_rollout(two_rooms, renderer, rollout, View("ego", view.camera, "night"), out)
    assert not out.exists()


class BrokenAfterThree:
    """A renderer that fails in the fourth frame."""

    def __init__(self, inner: Renderer):
        self.name, self.light = inner.name, inner.light
        self._inner, self._count = inner, 0

    def first_hit_m(self, *args: Any) -> float:
        return self._inner.first_hit_m(*args)

    def render(self, *args: Any) -> tuple[np.ndarray, np.ndarray]:
        self._count += 1
        if self._count > 3:
            raise RuntimeError("out of light")
        return self._inner.render(*args)


def test_a_failure_leaves_no_half_video(
    two_rooms: SceneBundle, renderer: Renderer, rollout: Rollout, tmp_path: Path
) -> None:
    view = make_view("ego", "aliengo", width_px=64, height_px=48)
    with pytest.raises(RuntimeError, match="out of light"):
        render_rollout(
            two_rooms, cast(Renderer, BrokenAfterThree(renderer)), rollout, view, tmp_path
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("storage", sorted(rollout_views.DEPTH_WRITERS))
def test_a_depth_encoder_that_fails_ends_the_rendering(
    two_rooms: SceneBundle,
    renderer: Renderer,
    rollout: Rollout,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    storage: str,
) -> None:
    def full_disk(*_: object) -> int:
        raise OSError("no space left on device")

    file, _, *facts = rollout_views.DEPTH_WRITERS[storage]
    monkeypatch.setitem(rollout_views.DEPTH_WRITERS, storage, (file, full_disk, *facts))
    view = make_view("ego", "aliengo", width_px=64, height_px=48)
    with pytest.raises(OSError, match="no space left"):
        render_rollout(two_rooms, renderer, rollout, view, tmp_path, depth_storage=storage)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["ego", "chase"])
def test_film_strips_show_what_was_recorded(
    two_rooms: SceneBundle, renderer: Renderer, rollout: Rollout, tmp_path: Path, kind: str
) -> None:
    view = make_view(kind, "aliengo", width_px=32, height_px=32, light="DL300")
    night = make_renderer(two_rooms, "embree", light="DL300")
    render_rollout(two_rooms, night, rollout, view, tmp_path)
    frames, robot = read_frame_folder(tmp_path), get_robot("aliengo")
    out = tmp_path / "strip.jpg"
    strip = film_strip(out, renderer, rollout, frames, robot, columns=3, tile_px=64)
    behind = 0 if kind == "chase" else 48 + 4
    assert strip.shape == (64 + 64 + 4 + behind, 3 * 64 + 3 * 4 + SCALE_PX, 3)
    assert out.stat().st_size > 1000
    first = cv2.resize(read_rgb_video(frames.rgb_video)[0], (64, 64))
    image = strip[:40, :64].astype(int)  # above the time
    assert np.abs(image - first[:40]).mean() < 4
    # The scale beside the depth: near is warm, far is blue.
    scale = strip[68:132, 3 * 68 + 2].astype(int)
    assert scale[0, 2] > scale[0, 0] and scale[-1, 0] > scale[-1, 2]


def test_clip(renderer: Renderer, rollout: Rollout, tmp_path: Path) -> None:
    last = third_person_clip(
        tmp_path / "clip.mp4",
        renderer,
        rollout,
        1.0,
        frames_per_second=10,
        width_px=64,
        height_px=48,
    )
    clip = read_rgb_video(tmp_path / "clip.mp4")
    assert clip.shape == (11, 48, 64, 3) or clip.shape == (10, 48, 64, 3)
    assert np.abs(clip[-1].astype(int) - last).mean() < 12  # it ends with the end


def test_depth_pictures_distinguish_near_far_and_invalid() -> None:
    depth = np.full((1, 300), 0.7, dtype=np.float32)
    depth[0, :3] = 0.0, 0.5, 20.0
    invalid, near, far = depth_picture(depth)[0, :3].astype(int)
    assert invalid[0] == invalid[1] == invalid[2] > 0  # grey
    assert near[0] > near[2]
    assert far[2] > far[0]
    assert far[2] > 128  # blue, not black
    # What is near has half of the colours: that in the middle is of 3.6 m.
    middle, far = depth_picture(np.array([[3.6, 11.25]], np.float32))[0].astype(int)
    assert middle[1] > 200 and far[2] > far[0]  # green, blue


def test_a_depth_has_one_colour_in_every_strip() -> None:
    near, far = np.full((2, 2), 1.5, np.float32), np.full((2, 2), 9.0, np.float32)
    alone, among = depth_picture(near), depth_picture(np.vstack([near, far]))
    assert (alone == among[:2]).all()
    assert (depth_picture(far * 10) == depth_picture(np.full((2, 2), FAR_M, np.float32))).all()


@pytest.mark.parametrize(("height_px", "labels"), [(64, 3), (107, 4), (240, 6)])
def test_the_labels_of_a_depth_scale_fit(height_px: int, labels: int) -> None:
    ink = depth_scale(height_px)[:, SCALE_PX // 4 + 5 :].max(axis=2) < 100
    assert ink.any() and not ink[[0, -1]].any() and not ink[:, -1].any()
    lines = np.flatnonzero(np.diff(np.flatnonzero(ink.any(axis=1))) > 1)
    assert len(lines) == labels - 1  # apart from each other


@pytest.mark.parametrize("scale", [20.0, 47.0])
def test_the_map_shows_things_where_it_says(
    two_rooms: SceneBundle, renderer: Renderer, scale: float
) -> None:
    level = top_down_map(two_rooms, renderer, 0, scale)
    assert level.px_per_m == scale
    blue = level.image[..., 2].astype(int) - level.image[..., 0] > 40
    rows, columns = np.nonzero(blue)
    low, high = LOWER[-1], UPPER[-1]
    left, right = ((x - level.left_m) * scale for x in (low[0], high[0]))
    top, bottom = ((level.top_m - y) * scale for y in (high[1], low[1]))
    assert np.abs(np.array([columns.min(), columns.max() + 1]) - [left, right]).max() < 1.2
    assert np.abs(np.array([rows.min(), rows.max() + 1]) - [top, bottom]).max() < 1.2
    assert (level.image[0, 0] == 250).all()  # paper outside


def test_a_map_stays_small_enough(two_rooms: SceneBundle, renderer: Renderer) -> None:
    level = top_down_map(two_rooms, renderer, 0, 1e4)
    assert max(level.image.shape) <= 2001
