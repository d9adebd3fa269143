"""Depth of a unit as a video of codes, whichever way the unit stores it, and back."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.camera import DepthRange
from ..core.errors import FileFormatError
from ..lerobot.layout import DEPTH_KEY
from ..lerobot.units.rows import stores_images
from ..lerobot.units.unit import EpisodeUnit
from ..video.depth_codes import (
    ANY_NEAR_M,
    codes_to_depth,
    decode_depth_tiff,
    millimetres_to_codes,
)
from ..video.mp4 import write_depth_video


def depth_range_of(unit: EpisodeUnit) -> DepthRange:
    """Return the range of a unit's depth."""
    return DepthRange(unit.columns["depth_near_m"], unit.columns["depth_far_m"])


@contextlib.contextmanager
def depth_video(unit: EpisodeUnit) -> Iterator[Path]:
    """Yield a video of the unit's depth: its own, or one made of its images for a while.

    Raises:
        FileFormatError: an image is damaged, or holds depths that no code stands for.
    """
    if not stores_images(unit.features):
        yield unit.video(DEPTH_KEY)
        return
    limits = depth_range_of(unit)
    images = (codes_to_depth(codes, limits) for codes in _image_codes(unit, limits))
    with tempfile.TemporaryDirectory(prefix=".vlnpe-tmp-") as temporary:
        path = Path(temporary) / f"{DEPTH_KEY}.mp4"
        write_depth_video(
            path, images, unit.frames_per_second, DepthRange(ANY_NEAR_M, limits.far_m)
        )
        yield path


def _image_codes(unit: EpisodeUnit, depth_range: DepthRange) -> Iterator[NDArray[np.uint16]]:
    for number, image in enumerate(unit.rows()[DEPTH_KEY].to_pylist()):
        try:
            codes = millimetres_to_codes(decode_depth_tiff(image["bytes"]), depth_range)
        except (TypeError, ValueError) as error:
            raise FileFormatError(unit.folder, f"depth image {number}: {error}") from error
        yield codes
