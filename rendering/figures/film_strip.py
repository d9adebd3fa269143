"""A film strip of a rendered episode: what its camera recorded, and the robot from behind."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ...collectors.robots import RobotSpec
from ...formats.core.rollout import Rollout
from ...formats.rendered.folder import FrameFolder
from ...formats.video.depth_codes import codes_to_depth
from ...formats.video.depth_picture import depth_picture, depth_scale
from ...formats.video.mp4 import codes_of_frame
from ...formats.video.stream import pick_frames
from ..camera.rollout_views import RolloutFrames
from ..camera.views import chase_view
from ..interface import Renderer
from .pictures import Picture, save_picture, stamp

GAP_PX = 4
PAPER = 255


def film_strip(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    frames: FrameFolder,
    robot: RobotSpec,
    *,
    columns: int = 6,
    tile_px: int = 240,
) -> Picture:
    """Write a film strip of a rendered rollout: `columns` moments from start to end, side by side.

    Its rows are the recorded colours, the recorded depth with a scale in metres, and, unless that
    is what was recorded, the robot from behind.

    Args:
        path: `.png` or `.jpg`.
        renderer: of the rollout's scene; draws the robot from behind, in a light to see it by.
        frames: rendered from it.
        columns: number of moments.
        tile_px: width of a moment [px].

    Returns:
        The picture, (H, W, 3) uint8 sRGB.

    Raises:
        FileFormatError: a video is damaged.
    """
    samples = frames.arrays["sample_index"]
    numbers = np.linspace(0, len(samples) - 1, columns).round().astype(int).tolist()
    colours = [
        _tile(np.asarray(frame.to_ndarray(format="rgb24")), tile_px)
        for frame in pick_frames(frames.rgb_video, numbers)
    ]
    for tile, number in zip(colours, numbers, strict=True):
        stamp(tile, f"{rollout.time_s[samples[number]]:.1f} s")
    codes = (
        _tile(codes_of_frame(frames.depth_video, frame, frames.depth_range), tile_px)
        for frame in pick_frames(frames.depth_video, numbers)
    )
    depths = [codes_to_depth(code, frames.depth_range) for code in codes]
    rows = [colours, [*map(depth_picture, depths), depth_scale(len(depths[0]))]]
    if frames.facts["kind"] != "chase":
        behind = chase_view(renderer, tile_px, round(0.75 * tile_px))
        plan = RolloutFrames.plan(renderer, rollout, behind, samples[numbers], robot)
        rows.append([rgb for rgb, _ in plan.render(renderer)])
    picture = _grid(rows)
    save_picture(path, picture)
    return picture


def _tile(image: NDArray[Any], width_px: int) -> NDArray[Any]:
    """Return an image in another width; depth is not mixed across edges."""
    height = max(1, round(image.shape[0] * width_px / image.shape[1]))
    how = cv2.INTER_AREA if image.ndim == 3 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(image, (width_px, height), interpolation=how), image.dtype)


def _grid(rows: Sequence[Sequence[Picture]]) -> Picture:
    """Return rows of pictures, each row of one height, as one picture on white paper."""
    widths = [sum(tile.shape[1] + GAP_PX for tile in row) - GAP_PX for row in rows]
    heights = [row[0].shape[0] for row in rows]
    sheet = np.full((sum(heights) + GAP_PX * (len(rows) - 1), max(widths), 3), PAPER, np.uint8)
    top = 0
    for row, height in zip(rows, heights, strict=True):
        left = 0
        for tile in row:
            sheet[top : top + height, left : left + tile.shape[1]] = tile
            left += tile.shape[1] + GAP_PX
        top += height + GAP_PX
    return sheet
