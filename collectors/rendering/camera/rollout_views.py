"""Rendering of recorded rollouts: videos, camera poses and intrinsics in one folder."""

from __future__ import annotations

import functools
import queue
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....formats.core.atomic import atomic_file, write_json
from ....formats.core.camera import DepthRange
from ....formats.core.errors import UnknownNameError
from ....formats.core.rollout import Rollout
from ....formats.rendered.image_counts import new_depth_counts, new_rgb_counts
from ....formats.scene.bundle import SceneBundle
from ....formats.video.mp4 import DEPTH_CODEC, RGB_CODECS, write_depth_video, write_rgb_video
from ...robots import RobotSpec, get_robot
from ..frame import Frame, Pose
from ..interface import Renderer
from ..light.lights import get_light
from ..scene.robot_body import RobotBody, RobotGeometryPose
from .extras import Extras, write_extras
from .mounting import body_for
from .views import VIEWS, CameraPath, Shot, View

DEPTH_VIDEO = "depth.mp4"

Picture = tuple[NDArray[np.uint8], NDArray[np.float32]]


@dataclass(frozen=True)
class RolloutFrames:
    """The frames of a rollout before they are rendered.

    Attributes:
        rollout: recorded states.
        view: camera, light and renderer.
        body: the robot's body.
        sample_index: (N,) samples of the rollout.
        path: camera poses of the N frames.
        lamp: robot's camera that carries the lamp of the light `CL`; None = the view's camera.
    """

    rollout: Rollout
    view: View
    body: RobotBody
    sample_index: NDArray[np.int64]
    path: CameraPath
    lamp: str | None = None

    @classmethod
    def plan(
        cls,
        renderer: Renderer,
        rollout: Rollout,
        view: View,
        samples: NDArray[np.int64],
        robot: RobotSpec | None = None,
    ) -> RolloutFrames:
        """Compute the camera poses of a view at `samples` (N,).

        Args:
            renderer: renderer of the view's name and light.
            rollout: recorded states.
            view: camera, light and renderer.
            samples: indices of samples of the rollout.
            robot: robot of the rollout; None = the registry's robot of that name.

        Raises:
            UnknownNameError: no such view kind or robot; the message lists the valid names.
            ValueError: the renderer is not the one that the view names.
        """
        if view.kind not in VIEWS:
            raise UnknownNameError("camera", view.kind, VIEWS)
        if (renderer.name, renderer.light) != (view.renderer, view.light):
            raise ValueError(
                f"view {view.name} requires renderer {view.renderer} with light {view.light}, "
                f"not {renderer.name} with {renderer.light}"
            )
        robot = robot or get_robot(rollout.robot)
        body = _body(robot, tuple(rollout.joint_names), view)
        shot = Shot(rollout, samples, view.camera, robot, body, renderer)
        kind = VIEWS[view.kind]
        carried = get_light(view.light).lamp > 0 and not kind.onboard
        lamp = robot.camera.name if carried else None
        return cls(rollout, view, body, samples, kind.path(shot), lamp)

    def render(self, renderer: Renderer) -> Iterator[Picture]:
        """Yield RGB (H, W, 3) uint8 and depth (H, W) float32 [m] of each frame."""
        for n in range(len(self.sample_index)):
            yield renderer.render(self.view.camera, *self._instant(n))

    def render_labelled(self, renderer: Renderer) -> Iterator[Frame]:
        """Yield each frame with the labels of its pixels."""
        for n in range(len(self.sample_index)):
            yield renderer.render_labelled(self.view.camera, *self._instant(n))

    def _instant(
        self, n: int
    ) -> tuple[
        NDArray[np.float64], NDArray[np.float64], RobotGeometryPose | None, float, Pose | None
    ]:
        """Return the arguments of `Renderer.render` for frame `n`, after the camera."""
        sample = self.sample_index[n]
        state = (
            self.rollout.position_world_m[sample],
            self.rollout.quat_wxyz[sample],
            self.rollout.joint_position_rad[sample],
        )
        return (
            self.path.position_world_m[n],
            self.path.quat_wxyz[n],
            self.body.pose(*state) if self.view.shows_robot else None,
            float(self.path.cut_above_m[n]),
            self.body.camera_pose(self.lamp, *state) if self.lamp else None,
        )


# Tessellating a body, and building its ray structures, takes as long as drawing four frames.
@functools.lru_cache(maxsize=4)
def _body(robot: RobotSpec, joint_names: tuple[str, ...], view: View) -> RobotBody:
    return body_for(robot, joint_names, view)


def render_rollout(
    bundle: SceneBundle,
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    out_dir: Path,
    frames_per_second: int = 4,
    *,
    depth_range: DepthRange | None = None,
    codec: str = "h264",
    robot: RobotSpec | None = None,
    extras: Extras | None = None,
    on_depth: Callable[[NDArray[np.uint16]], None] | None = None,
) -> int:
    """Render a rollout into `out_dir`; return the number of frames.

    Writes `rgb.mp4`, `depth.mp4` (12-bit codes, see `formats/video/depth_codes.py`), `frames.npz`
    (`sample_index` (N,), `time_s` (N,), `camera_position_world_m` (N, 3) and `camera_quat_wxyz`
    (N, 4) of the optical frame, and histograms of the values, see
    `formats/rendered/image_counts.py`) and `meta.json`. Memory does not grow with the rollout's
    length.

    Args:
        bundle: the scene the renderer was built for.
        renderer: renderer of the view's name and light.
        rollout: recorded states.
        view: camera, light and renderer.
        out_dir: created if missing; the caller makes it atomic.
        frames_per_second: a divisor of the rollout's sample rate.
        depth_range: clip range of the stored depth, default `DepthRange()`.
        codec: key of `formats.video.RGB_CODECS`.
        robot: robot of the rollout; None = the registry's robot of that name.
        extras: optional videos, default none.
        on_depth: called with the depth codes (H, W) of each frame as they are encoded.

    Raises:
        UnknownNameError: unknown view kind, robot or codec; the message lists the valid names.
        ValueError: the frame rate does not divide 100, or renderer and view do not match.
    """
    if codec not in RGB_CODECS:
        raise UnknownNameError("video codec", codec, RGB_CODECS)
    limits = depth_range or DepthRange()
    samples = rollout.frame_samples(frames_per_second)
    frames = RolloutFrames.plan(renderer, rollout, view, samples, robot)
    out_dir.mkdir(parents=True, exist_ok=True)
    extras = extras or Extras()
    if extras.labelled:
        labelled = frames.render_labelled(renderer)
    else:
        nothing = np.zeros((0, 0), dtype=np.int32)
        labelled = (Frame(*picture, nothing, nothing) for picture in frames.render(renderer))
    pictures = write_extras(out_dir, labelled, extras, bundle, frames_per_second, limits)
    rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
    count = _write_videos(
        out_dir,
        pictures,
        frames_per_second,
        limits,
        codec,
        rgb_counts=rgb_counts,
        depth_counts=depth_counts,
        on_depth=on_depth,
    )
    with atomic_file(out_dir / "frames.npz") as temporary:
        np.savez(
            temporary,
            sample_index=samples,
            time_s=rollout.time_s[samples],
            camera_position_world_m=frames.path.position_world_m,
            camera_quat_wxyz=frames.path.quat_wxyz,
            rgb_counts=rgb_counts,
            depth_counts=depth_counts,
        )
    write_json(
        out_dir / "meta.json",
        _facts(bundle, rollout, view, limits, frames=count, rate=frames_per_second, codec=codec)
        | extras.facts(),
    )
    return count


def _facts(
    bundle: SceneBundle,
    rollout: Rollout,
    view: View,
    depth_range: DepthRange,
    *,
    frames: int,
    rate: int,
    codec: str,
) -> dict[str, object]:
    return {
        "scene_id": bundle.scene_id,
        "episode_id": rollout.episode.episode_id,
        "robot": rollout.robot,
        "controller": rollout.controller,
        "view": view.name,
        "camera_height_m": view.height_m,
        "camera_pitch_down_deg": view.pitch_down_deg,
        "kind": view.kind,
        "renderer": view.renderer,
        "light": view.light,
        "frames": frames,
        "frames_per_second": rate,
        "camera": view.camera.to_json(),
        "depth": {
            "meaning": "planar z in metres, 0 = invalid",
            "near_m": depth_range.near_m,
            "far_m": depth_range.far_m,
            "file": DEPTH_VIDEO,
            "codec": DEPTH_CODEC.canonical,
            "pixel_format": DEPTH_CODEC.pixel_format,
        },
        "rgb": {"file": "rgb.mp4", "codec": codec},
    }


def _write_videos(
    folder: Path,
    frames: Iterator[Picture],
    frames_per_second: int,
    depth_range: DepthRange,
    codec: str,
    *,
    rgb_counts: NDArray[np.int64],
    depth_counts: NDArray[np.int64],
    on_depth: Callable[[NDArray[np.uint16]], None] | None = None,
) -> int:
    """Encode both videos in one pass over `frames`, depth in a thread beside RGB."""
    waiting: queue.Queue[NDArray[np.float32] | BaseException | None] = queue.Queue(maxsize=4)

    def depth_frames() -> Iterator[NDArray[np.float32]]:
        while (item := waiting.get()) is not None:
            if isinstance(item, BaseException):
                raise item  # so that no truncated video is kept when rendering fails
            yield item

    def rgb_frames(depth_writer: Future[int]) -> Iterator[NDArray[np.uint8]]:
        for rgb, depth in frames:
            _put(waiting, depth, depth_writer)
            yield rgb

    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="depth") as pool:
        depth_writer = pool.submit(
            write_depth_video,
            folder / DEPTH_VIDEO,
            depth_frames(),
            frames_per_second,
            depth_range,
            depth_counts,
            on_depth,
        )
        try:
            colours = rgb_frames(depth_writer)
            count = write_rgb_video(
                folder / "rgb.mp4", colours, frames_per_second, codec, rgb_counts
            )
        except BaseException as error:
            _put(waiting, error, depth_writer)
            raise
        _put(waiting, None, depth_writer)
        depth_writer.result()
    return count


def _put(
    waiting: queue.Queue[NDArray[np.float32] | BaseException | None],
    item: NDArray[np.float32] | BaseException | None,
    reader: Future[int],
) -> None:
    """Queue an item unless the reader has ended; `result` then raises the reader's own error."""
    while not reader.done():
        try:
            waiting.put(item, timeout=0.5)
        except queue.Full:
            continue
        return
    if not isinstance(item, BaseException):
        reader.result()
