"""The images of one episode of the VLN-PE layout: NumPy files of colour and depth."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.format import open_memmap
from numpy.typing import NDArray

from ..convert.stored_depth import depth_range_of
from ..core.errors import FileFormatError
from ..lerobot import layout as v3
from ..lerobot.units.unit import EpisodeUnit
from ..video.mp4 import iterate_depth_video, iterate_rgb_video
from . import layout


def write_frames(
    root: Path, number: int, unit: EpisodeUnit, depth: Path, shown: NDArray[np.int64]
) -> None:
    """Write the images of the frames with the ascending numbers `shown`, which may repeat.

    Raises:
        FileFormatError: If a video has too few frames.
    """
    repeats = np.bincount(shown).tolist()
    colours = iterate_rgb_video(unit.video(v3.RGB_KEY))
    _write_images(root, number, layout.RGB_KEY, unit.length, _repeated(colours, repeats))
    depths = (stored_depth(image) for image in iterate_depth_video(depth, depth_range_of(unit)))
    _write_images(root, number, layout.DEPTH_KEY, unit.length, _repeated(depths, repeats))


def _repeated(images: Iterable[NDArray[Any]], repeats: Sequence[int]) -> Iterator[NDArray[Any]]:
    """Yield each image `repeats` times; images beyond the end of `repeats` are dropped."""
    for image, times in zip(images, repeats, strict=False):
        for _ in range(times):
            yield image


def stored_depth(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the depth [m], 0 = nothing there, as the layout stores it."""
    scaled = np.where(depth_m > 0, depth_m / np.float32(layout.DEPTH_UNIT_M), np.float32(1))
    return np.minimum(scaled, np.float32(1)).astype(np.float32)


def _write_images(
    root: Path, number: int, key: str, count: int, images: Iterable[NDArray[Any]]
) -> None:
    path = root / layout.place(layout.VIDEO_PATH, number, video_key=key)
    path.parent.mkdir(parents=True, exist_ok=True)
    out: Any = None
    done = 0
    for image in images:
        if out is None:
            out = open_memmap(path, "w+", image.dtype, (count, *image.shape))
        out[done] = image
        done += 1
    if done != count:
        raise FileFormatError(path, f"contains {done} images; the unit has {count} frames")
    out.flush()
