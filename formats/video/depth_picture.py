"""Depth as colours for people, on one scale in every picture, with ticks in metres."""

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..core.arrays import F32, U8

FAR_M = 20.0  # what lies farther looks as if it lay there
TICKS_M = (0, 1, 2, 5, 10, 20)
SCALE_PX = 64  # width of the scale, beside the last picture of a row
_PAPER = 255
_LEVELS = 256
_DARKEST = 32  # of the levels; darker blues look black
_UNMEASURED = 150  # grey, which no depth has
_FONT_PX = 15


def depth_picture(depth_m: F32) -> U8:
    """Return depth (H, W) [m] as colours (H, W, 3): warm is near, blue is `FAR_M` and farther.

    Colours change with the logarithm of 1 m more than the depth, because most of what a robot in a
    room sees is near. What is invalid (0) is grey.
    """
    farness = np.log1p(np.clip(depth_m, 0.0, FAR_M)) / np.log1p(FAR_M)
    level = np.round(_LEVELS - 1 - (_LEVELS - 1 - _DARKEST) * farness).astype(np.uint8)
    colours = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1].copy()
    colours[depth_m <= 0] = _UNMEASURED
    return colours.astype(np.uint8)


def depth_scale(height_px: int) -> U8:
    """Return (H, `SCALE_PX`, 3): the colours of depths as a column, far on top, with ticks.

    Ticks whose labels would touch those above them are left out; the ends are always there.
    """
    farness = np.linspace(1.0, 0.0, height_px, dtype=np.float32)[:, None]
    depth_m = np.expm1(farness * np.log1p(np.float32(FAR_M)))
    column = np.maximum(depth_m, np.float32(1e-3))  # 0 would be invalid
    bar_px = SCALE_PX // 4
    scale = np.full((height_px, SCALE_PX, 3), _PAPER, np.uint8)
    scale[:, :bar_px] = depth_picture(column)
    image = Image.fromarray(scale)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=_FONT_PX)
    top, bottom = _FONT_PX // 2 + 1, height_px - _FONT_PX // 2 - 2  # of the labels' middles
    last = -_FONT_PX
    for metres in reversed(TICKS_M):
        row = (1.0 - np.log1p(metres) / np.log1p(FAR_M)) * (height_px - 1)
        place = min(max(row, top), bottom)
        if metres and (place - last < _FONT_PX + 2 or bottom - place < _FONT_PX + 2):
            continue
        draw.line([(bar_px, row), (bar_px + 3, row)], fill="black")
        draw.text((bar_px + 5, place), f"{metres} m", font=font, fill="black", anchor="lm")
        last = place
    return np.asarray(image)
