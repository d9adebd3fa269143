"""Third-person clips and videos of rollouts, for people."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...collectors.robots import RobotSpec, get_robot
from ...formats.core.arrays import U8
from ...formats.core.atomic import atomic_file
from ...formats.core.rollout import Rollout
from ...formats.video.codecs import CLIP_CODEC, WATCH_CODEC
from ...formats.video.mp4 import write_rgb_video
from ..camera.rollout_frames import RolloutFrames
from ..camera.views import View, chase_view
from ..interface import Renderer

Picture = U8


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
    view = chase_view(renderer, width_px, height_px)
    pictures = _stamped(renderer, rollout, view, frames_per_second, spec, last_s)
    return write_clip(path, pictures, frames_per_second)


def write_clip(path: Path, frames: Iterator[Picture], frames_per_second: int) -> Picture:
    """Write a small `.mp4` for pages, and return its last frame."""
    last: list[Picture] = []

    def watched() -> Iterator[Picture]:
        for frame in frames:
            last[:] = [frame]
            yield frame

    write_rgb_video(path, watched(), frames_per_second, CLIP_CODEC)
    return last[0]


def watchable_video(
    path: Path,
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    frames_per_second: int = 25,
    robot: RobotSpec | None = None,
    *,
    on_part: Callable[[float], None] | None = None,
) -> int:
    """Write an `.mp4` of a whole rollout that plays in real time.

    Args:
        renderer: renderer of the view's name and light.
        frames_per_second: a divisor of 100.
        robot: robot of the rollout; None = the registry's robot of that name.
        on_part: called after each frame with the part of them that is done.

    Returns:
        The number of frames.

    Raises:
        ValueError: the frame rate does not divide 100, or the renderer is not the view's.
    """
    spec = robot or get_robot(rollout.robot)
    pictures = _stamped(renderer, rollout, view, frames_per_second, spec, on_part=on_part)
    return write_rgb_video(path, pictures, frames_per_second, WATCH_CODEC)


def _stamped(
    renderer: Renderer,
    rollout: Rollout,
    view: View,
    frames_per_second: int,
    robot: RobotSpec,
    last_s: float = math.inf,
    on_part: Callable[[float], None] | None = None,
) -> Iterator[Picture]:
    """Yield frames with their time in a corner."""
    samples = rollout.frame_samples(frames_per_second)
    samples = samples[rollout.time_s[samples] >= rollout.time_s[-1] - last_s]
    plan = RolloutFrames.plan(renderer, rollout, view, samples, robot)
    frames = zip(samples, plan.render(renderer), strict=True)
    for number, (sample, (picture, _)) in enumerate(frames, start=1):
        stamp(picture, f"{rollout.time_s[sample]:.1f} s")
        yield picture
        if on_part is not None:
            on_part(number / len(samples))


def save_picture(path: Path, picture: Picture) -> None:
    """Write (H, W, 3) uint8 as PNG or JPEG, depending on the path's suffix."""
    with atomic_file(path) as temporary:
        Image.fromarray(picture).save(temporary, quality=88)


def stamp(tile: Picture, text: str) -> None:
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
