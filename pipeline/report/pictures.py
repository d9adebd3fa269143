"""The images of a report, and their inclusion in the page."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...formats.core.images import data_uri, image_file

STAGE = "pictures"


@dataclass(frozen=True)
class Pictures:
    """Images and videos of a report.

    Attributes:
        maps: by `<scene>/<level>`; a JSON file beside each says where it lies.
        strips: by dataset.
        clips: by `<robot>/<controller>/<episode>`; the last frame lies beside each as `.jpg`.
    """

    maps: dict[str, Path]
    strips: dict[str, Path]
    clips: dict[str, Path]


JPEG_QUALITY = 86


def jpeg_uri(image: Path | NDArray[np.uint8], maximum_width_px: int = 1600) -> str:
    """Return an image file or an (H, W, 3) uint8 array as a JPEG data URI, shrunk to fit."""
    picture = Image.open(image) if isinstance(image, Path) else Image.fromarray(image)
    picture = picture.convert("RGB")
    if picture.width > maximum_width_px:
        height = round(picture.height * maximum_width_px / picture.width)
        picture = picture.resize((maximum_width_px, height), Image.Resampling.LANCZOS)
    return data_uri(image_file(picture, "JPEG", quality=JPEG_QUALITY), "image/jpeg")
