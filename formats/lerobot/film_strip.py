"""An image of a dataset for its card: frames of some episodes, depth below colour."""

from collections.abc import Sequence

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..core.arrays import U8
from ..video.depth_picture import depth_picture, depth_scale
from ..video.stream import pick_frames
from .layout import RGB_KEY
from .units.unit import EpisodeUnit

EPISODES, FRAMES = 3, 6
WIDTH_PX, GAP_PX = 160, 4
FONT_PX, LINE_PX = 12, 16
HEAD_PX = 2 * LINE_PX
LATIN_END, PUNCTUATION = 0x250, range(0x2000, 0x2070)  # what the font has letters for


def shown_units(count: int) -> list[int]:
    """Return which of `count` episodes to show: a few, evenly spaced."""
    return _spread(count, EPISODES)


def film_strip(units: Sequence[EpisodeUnit]) -> bytes:
    """Return a PNG: per episode, of at least one, a row of colour images over one of their depth.

    Above them stand the episode's name, its text if that is in Latin letters, and when each image
    was taken.
    """
    pictures = [(unit, _colours(unit), _depths(unit)) for unit in units]
    width = max(depths.shape[1] for _, _, depths in pictures)
    rows = [row for unit, *both in pictures for row in (_head(unit, width), *both)]
    sheet = np.full((sum(len(row) + GAP_PX for row in rows) - GAP_PX, width, 3), 255, np.uint8)
    top = 0
    for row in rows:
        sheet[top : top + len(row), : row.shape[1]] = row
        top += len(row) + GAP_PX
    sheet = np.pad(sheet, ((GAP_PX, GAP_PX), (GAP_PX, GAP_PX), (0, 0)), constant_values=255)
    done, data = cv2.imencode(".png", sheet[..., ::-1])
    if not done:
        raise ValueError(f"cannot encode an image of {sheet.shape} as PNG")
    return data.tobytes()


def _spread(count: int, most: int) -> list[int]:
    """Return up to `most` evenly spaced indices below `count`, the first and last included."""
    return sorted(set(np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()))


def _head(unit: EpisodeUnit, width_px: int) -> U8:
    """Return (`HEAD_PX`, `width_px`, 3): the episode in a line, and the times of its images."""
    image = Image.new("RGB", (width_px, HEAD_PX), "white")
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=FONT_PX)
    line = str(unit.columns["episode_uid"])
    if all(ord(c) < LATIN_END or ord(c) in PUNCTUATION for c in unit.task):
        line += ": " + " ".join(unit.task.split())
    line = line[:width_px]  # no letter is narrower than a pixel
    while font.getlength(line) > width_px:
        line = line.removesuffix("…")[:-1] + "…"
    draw.text((0, 0), line, font=font, fill="black")
    for k, number in enumerate(_spread(unit.length, FRAMES)):
        time = f"{number / unit.frames_per_second:.2f} s"
        draw.text((k * (WIDTH_PX + GAP_PX), LINE_PX), time, font=font, fill="black")
    return np.asarray(image)


def _colours(unit: EpisodeUnit) -> U8:
    numbers = _spread(unit.length, FRAMES)
    frames = pick_frames(unit.video(RGB_KEY), numbers)
    images = (np.asarray(frame.to_ndarray(format="rgb24"), np.uint8) for frame in frames)
    return _row([_small(image) for image in images])


def _depths(unit: EpisodeUnit) -> U8:
    numbers = _spread(unit.length, FRAMES)
    images = [_small(depth_picture(depth_m)) for depth_m in unit.depth_m(numbers)]
    return _row([*images, depth_scale(len(images[0]))])


def _small(image: U8) -> U8:
    height = max(1, round(image.shape[0] * WIDTH_PX / image.shape[1]))
    return np.asarray(cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA), np.uint8)


def _row(images: Sequence[U8]) -> U8:
    gap = np.full((images[0].shape[0], GAP_PX, 3), 255, np.uint8)
    parts = [part for image in images for part in (image, gap)]
    return np.concatenate(parts[:-1], axis=1)
