"""Write a rendered rollout: videos, camera poses and intrinsics in one folder."""

import queue
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...collectors.robots import RobotSpec
from ...formats.core.arrays import F32, I64, U8, U16
from ...formats.core.atomic import atomic_file, write_json
from ...formats.core.camera import DepthRange
from ...formats.core.errors import check_name
from ...formats.core.rollout import Rollout
from ...formats.rendered.image_counts import new_depth_counts, new_rgb_counts
from ...formats.scene.bundle import SceneBundle
from ...formats.video.codecs import DEPTH_CODEC, RGB_CODECS
from ...formats.video.depth_codes import MILLIMETRE_PIXEL_FORMAT
from ...formats.video.depth_images import CODEC, write_depth_images
from ...formats.video.mp4 import write_depth_video, write_rgb_video
from ..frame import Frame
from ..interface import Renderer
from .extras import Extras, write_extras
from .rollout_frames import Picture, RolloutFrames
from .views import View

# What writes depth by how datasets store it, and into what: see `formats/video`.
DEPTH_WRITERS = {
    "video": ("depth.mp4", write_depth_video, DEPTH_CODEC.canonical, DEPTH_CODEC.pixel_format),
    "image": ("depth.mov", write_depth_images, CODEC, MILLIMETRE_PIXEL_FORMAT),
}


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
    depth_storage: str = "video",
    on_depth: Callable[[U16], None] | None = None,
) -> int:
    """Render a rollout into `out_dir`; return the number of frames.

    Writes `rgb.mp4`, depth (`depth.mp4` of 12-bit codes, see `formats/video/depth_codes.py`, or
    `depth.mov` of images of whole millimetres), `frames.npz` (`sample_index` (N,), `time_s` (N,),
    `camera_position_world_m` (N, 3) and `camera_quat_wxyz` (N, 4) of the optical frame, and
    histograms of the values, see `formats/rendered/image_counts.py`) and `meta.json`. Memory does
    not grow with the rollout's length.

    Args:
        bundle: the scene the renderer was built for.
        renderer: renderer of the view's name and light.
        out_dir: created if missing; the caller makes it atomic.
        frames_per_second: a divisor of the rollout's sample rate.
        depth_range: clip range of the stored depth, default `DepthRange()`.
        codec: key of `formats.video.RGB_CODECS`.
        robot: robot of the rollout; None = the registry's robot of that name.
        extras: optional videos, default none.
        depth_storage: key of `DEPTH_WRITERS`.
        on_depth: called with the depth codes (H, W) of each frame as they are encoded.

    Raises:
        UnknownNameError: unknown view kind, robot or codec; the message lists the valid names.
        ValueError: the frame rate does not divide 100, or renderer and view do not match.
    """
    check_name("video codec", codec, RGB_CODECS)
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
        depth_storage=depth_storage,
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
    depth_file, _, depth_codec, pixel_format = DEPTH_WRITERS[depth_storage]
    facts: dict[str, object] = {
        "scene_id": bundle.scene_id,
        "episode_id": rollout.episode.episode_id,
        "robot": rollout.robot,
        "controller": rollout.controller,
        "view": view.name,
        "rig": asdict(view.rig) if view.rig else None,
        "kind": view.kind,
        "renderer": view.renderer,
        "light": view.light,
        "frames": count,
        "frames_per_second": frames_per_second,
        "camera": view.camera.to_json(),
        "depth": {
            "meaning": "planar z in metres, 0 = invalid",
            "near_m": limits.near_m,
            "far_m": limits.far_m,
            "file": depth_file,
            "codec": depth_codec,
            "pixel_format": pixel_format,
        },
        "rgb": {"file": "rgb.mp4", "codec": codec},
    }
    write_json(out_dir / "meta.json", facts | extras.facts())
    return count


def _write_videos(
    folder: Path,
    frames: Iterator[Picture],
    frames_per_second: int,
    depth_range: DepthRange,
    codec: str,
    *,
    rgb_counts: I64,
    depth_counts: I64,
    depth_storage: str,
    on_depth: Callable[[U16], None] | None = None,
) -> int:
    """Encode both videos in one pass over `frames`, depth in a thread beside RGB."""
    depth_file, write_depth, *_ = DEPTH_WRITERS[depth_storage]
    waiting: queue.Queue[F32 | BaseException | None] = queue.Queue(maxsize=4)

    def depth_frames() -> Iterator[F32]:
        while (item := waiting.get()) is not None:
            if isinstance(item, BaseException):
                raise item  # so that no truncated video is kept when rendering fails
            yield item

    def rgb_frames(depth_writer: Future[int]) -> Iterator[U8]:
        for rgb, depth in frames:
            _put(waiting, depth, depth_writer)
            yield rgb

    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="depth") as pool:
        depth_writer = pool.submit(
            write_depth,
            folder / depth_file,
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
    waiting: queue.Queue[F32 | BaseException | None],
    item: F32 | BaseException | None,
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
