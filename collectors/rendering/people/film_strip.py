"""A film strip of a rendered episode: what its camera recorded, and the robot from behind."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ....formats.core.rollout import Rollout
from ....formats.rendered.folder import FrameFolder
from ....formats.video.depth_codes import DEPTH_PIXEL_FORMAT, codes_to_depth
from ....formats.video.stream import pick_frames
from ...robots import RobotSpec
from ..camera.rollout_views import RolloutFrames
from ..camera.views import make_view
from ..interface import Renderer
from .pictures import Picture, save_picture, stamp

GAP_PX = 4
PAPER = 255
SCALE_PX = 64  # width of the depth's scale, beside the last tile
LEVELS = 256
DARKEST = 32  # of the levels; darker blues look black
UNMEASURED = 150  # grey, which no depth has


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
        _tile(np.asarray(frame.to_ndarray(format=DEPTH_PIXEL_FORMAT), np.uint16), tile_px)
        for frame in pick_frames(frames.depth_video, numbers)
    )
    depths = [codes_to_depth(one, frames.depth_range) for one in codes]
    near_m, far_m = shown_depths(depths)
    scale = depth_scale(len(depths[0]), near_m, far_m)
    rows = [colours, [*(depth_picture(depth, near_m, far_m) for depth in depths), scale]]
    if frames.facts["kind"] != "chase":
        behind = make_view(
            "chase",
            robot,
            width_px=tile_px,
            height_px=round(0.75 * tile_px),
            light=renderer.light,
            renderer=renderer.name,
        )
        plan = RolloutFrames.plan(renderer, rollout, behind, samples[numbers], robot)
        rows.append([rgb for rgb, _ in plan.render(renderer)])
    picture = _grid(rows)
    save_picture(path, picture)
    return picture


def shown_depths(depths_m: Sequence[NDArray[np.float32]]) -> tuple[int, int]:
    """Return the whole metres between which depths lie, but for the nearest; 0 is invalid."""
    valid = np.concatenate([depth[depth > 0] for depth in depths_m])
    low, high = np.percentile(valid, [1, 100]) if len(valid) else (0.0, 1.0)
    return math.floor(low), max(math.ceil(high), math.floor(low) + 1)


def depth_picture(depth_m: NDArray[np.float32], near_m: float, far_m: float) -> Picture:
    """Return depth (H, W) [m] as colours: warm up to `near_m`, blue from `far_m` on.

    Colours change with the square root of the depth, because most of what a robot in a room sees
    is near. What is invalid is grey.
    """
    near, far = np.sqrt([near_m, far_m])
    farness = np.clip((np.sqrt(depth_m) - near) / (far - near), 0.0, 1.0)
    level = np.round(LEVELS - 1 - (LEVELS - 1 - DARKEST) * farness).astype(np.uint8)
    colours = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1].copy()
    colours[depth_m <= 0] = UNMEASURED
    return colours.astype(np.uint8)


def _tile(image: NDArray[Any], width_px: int) -> NDArray[Any]:
    """Return an image in another width; depth is not mixed across edges."""
    height = max(1, round(image.shape[0] * width_px / image.shape[1]))
    how = cv2.INTER_AREA if image.ndim == 3 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(image, (width_px, height), interpolation=how), image.dtype)


def depth_scale(height_px: int, near_m: int, far_m: int) -> Picture:
    """Return the colours of depths as a column, far on top, with whole metres beside it."""
    near, far = math.sqrt(near_m), math.sqrt(far_m)
    column = np.square(np.linspace(far, near, height_px, dtype=np.float32))[:, None]
    column = np.maximum(column, np.float32(1e-3))  # 0 would be invalid
    scale = np.full((height_px, SCALE_PX, 3), PAPER, np.uint8)
    scale[:, : SCALE_PX // 4] = depth_picture(column, near_m, far_m)
    image = Image.fromarray(scale)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=15)
    labels = [(far_m, "lt"), (near_m, "lb")]
    if far_m - near_m > 1:
        between = range(near_m + 1, far_m)
        labels.append((min(between, key=lambda m: abs(2 * math.sqrt(m) - near - far)), "lm"))
    for metres, anchor in labels:
        share = (far - math.sqrt(metres)) / (far - near)
        place = (SCALE_PX // 4 + 5, 2 + share * (height_px - 5))
        draw.text(place, f"{metres} m", font=font, fill="black", anchor=anchor)
    return np.asarray(image)


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
