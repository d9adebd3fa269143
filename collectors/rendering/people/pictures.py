"""Film strips, third-person clips and videos of rollouts, for people."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ....formats.core.atomic import atomic_file
from ....formats.core.rollout import Rollout
from ....formats.video.mp4 import CLIP_CODEC, WATCH_CODEC, write_rgb_video
from ...robots import RobotSpec, get_robot
from ..camera.rollout_frames import RolloutFrames
from ..camera.views import View, make_view
from ..interface import Renderer

Picture = NDArray[np.uint8]

GAP_PX = 4
PAPER = 255
DEPTH_SHOWN_M = 8.0


def film_strip(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    *,
    columns: int = 6,
    tile_px: int = 240,
    robot: RobotSpec | None = None,
) -> Picture:
    """Write a film strip of a rollout: `columns` moments from start to end, side by side.

    Its rows are the robot's own view, its depth (warm = near), and the robot from behind.

    Args:
        path: `.png` or `.jpg`.
        renderer: renderer of the rollout's scene.
        rollout: recorded states.
        columns: number of moments.
        tile_px: width of a moment [px].
        robot: robot of the rollout; None = the registry's robot of that name.

    Returns:
        The picture, (H, W, 3) uint8 sRGB.
    """
    samples = np.linspace(0, len(rollout.time_s) - 1, columns).round().astype(np.int64)
    rows: list[list[Picture]] = []
    spec = robot or get_robot(rollout.robot)

    def frames_of(kind: str, aspect: float) -> RolloutFrames:
        view = make_view(
            kind,
            spec,
            width_px=tile_px,
            height_px=round(tile_px * aspect),
            light=renderer.light,
            renderer=renderer.name,
        )
        return RolloutFrames.plan(renderer, rollout, view, samples, spec)

    own = spec.camera.model
    frames = list(frames_of("ego", own.height_px / own.width_px).render(renderer))
    rows.append([rgb for rgb, _ in frames])
    rows.append([depth_picture(depth) for _, depth in frames])
    rows.append([rgb for rgb, _ in frames_of("chase", 0.75).render(renderer)])
    for tile, sample in zip(rows[0], samples, strict=True):
        _stamp(tile, f"{rollout.time_s[sample]:.1f} s")
    picture = _grid(rows)
    save_picture(path, picture)
    return picture


def third_person_clip(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    last_s: float = math.inf,
    *,
    frames_per_second: int = 10,
    width_px: int = 320,
    height_px: int = 240,
    robot: RobotSpec | None = None,
) -> Picture:
    """Write a small `.mp4` of the end of a rollout, seen from behind the robot.

    Args:
        path: output file.
        renderer: renderer of the rollout's scene.
        rollout: recorded states.
        last_s: duration of the clip [s].
        frames_per_second: a divisor of 100.
        width_px: width, even.
        height_px: height, even.
        robot: robot of the rollout; None = the registry's robot of that name.

    Returns:
        The last frame, (H, W, 3) uint8 sRGB.

    Raises:
        ValueError: the frame rate does not divide 100.
    """
    spec = robot or get_robot(rollout.robot)
    view = make_view(
        "chase",
        spec,
        width_px=width_px,
        height_px=height_px,
        light=renderer.light,
        renderer=renderer.name,
    )
    pictures = _stamped(renderer, rollout, view, frames_per_second, spec, last_s)
    last: list[Picture] = []

    def keeping_last() -> Iterator[Picture]:
        for picture in pictures:
            last[:] = [picture]
            yield picture

    write_rgb_video(path, keeping_last(), frames_per_second, CLIP_CODEC)
    return last[0]


def watchable_video(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    frames_per_second: int = 25,
    robot: RobotSpec | None = None,
) -> int:
    """Write an `.mp4` of a whole rollout that plays in real time.

    Args:
        path: output file.
        renderer: renderer of the view's name and light.
        rollout: recorded states.
        view: camera, light and renderer.
        frames_per_second: a divisor of 100.
        robot: robot of the rollout; None = the registry's robot of that name.

    Returns:
        The number of frames.

    Raises:
        ValueError: the frame rate does not divide 100, or the renderer is not the view's.
    """
    spec = robot or get_robot(rollout.robot)
    pictures = _stamped(renderer, rollout, view, frames_per_second, spec)
    return write_rgb_video(path, pictures, frames_per_second, WATCH_CODEC)


def _stamped(
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    frames_per_second: int,
    robot: RobotSpec,
    last_s: float = math.inf,
) -> Iterator[Picture]:
    """Yield frames with their time in a corner."""
    samples = rollout.frame_samples(frames_per_second)
    samples = samples[rollout.time_s[samples] >= rollout.time_s[-1] - last_s]
    plan = RolloutFrames.plan(renderer, rollout, view, samples, robot)
    for sample, (picture, _) in zip(samples, plan.render(renderer), strict=True):
        _stamp(picture, f"{rollout.time_s[sample]:.1f} s")
        yield picture


def depth_picture(depth_m: NDArray[np.float32], far_m: float = DEPTH_SHOWN_M) -> Picture:
    """Return depth (H, W) [m] as colours: warm near, dark blue from `far_m` on, black invalid."""
    level = np.round(255 * (1.0 - np.clip(depth_m / far_m, 0.0, 1.0))).astype(np.uint8)
    colors = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1].copy()
    colors[depth_m <= 0] = 0
    return colors.astype(np.uint8)


def save_picture(path: Path, picture: Picture) -> None:
    """Write (H, W, 3) uint8 as PNG or JPEG, depending on the path's suffix."""
    with atomic_file(path) as temporary:
        Image.fromarray(picture).save(temporary, quality=88)


def _stamp(tile: Picture, text: str) -> None:
    """Write `text` into the tile's lower left corner, in place."""
    size = max(10, tile.shape[1] // 16)
    image = Image.fromarray(tile)
    draw = ImageDraw.Draw(image, "RGBA")
    font = ImageFont.load_default(size=size)
    left, top, right, bottom = draw.textbbox((0, 0), text, font=font)
    box = (0, tile.shape[0] - (bottom - top) - size, right - left + size, tile.shape[0])
    draw.rectangle(box, fill=(0, 0, 0, 140))
    draw.text((0.5 * size - left, box[1] + 0.5 * size - top), text, font=font, fill="white")
    tile[:] = np.asarray(image)


def _grid(rows: list[list[Picture]]) -> Picture:
    across = np.full((1, GAP_PX, 3), PAPER, dtype=np.uint8)
    strips: list[Picture] = []
    for row in rows:
        gap = np.repeat(across, row[0].shape[0], axis=0)
        parts = [part for tile in row for part in (gap, tile)][1:]
        strip = np.concatenate(parts, axis=1)
        if strips:
            strips.append(np.full((GAP_PX, strip.shape[1], 3), PAPER, dtype=np.uint8))
        strips.append(strip)
    return np.concatenate(strips, axis=0)
