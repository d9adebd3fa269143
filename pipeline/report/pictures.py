"""The images of a report, and how its pages are rendered and hold them."""

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from numpy.typing import NDArray
from PIL import Image

from ...formats.core.images import data_uri, image_file

STAGE = "pictures"
JPEG_QUALITY = 86


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


def rendered_page(template: str, **values: Any) -> str:
    """Return a page as HTML: a template of this folder, filled in."""
    environment = Environment(
        loader=PackageLoader("vlnpe.pipeline.report", "."),
        autoescape=select_autoescape(default_for_string=True, default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(version=version("vlnpe"), **values)


def film_bytes(film: Path) -> int:
    """Return how much an embedded film and its last frame, beside it as `.jpg`, add to a page."""
    size = film.stat().st_size + film.with_suffix(".jpg").stat().st_size
    return 4 * -(-size // 3)  # base64


def embedded_film(film: Path) -> dict[str, str]:
    """Return template values of a film and its last frame."""
    return {
        "video": data_uri(film.read_bytes(), "video/mp4"),
        "poster": data_uri(film.with_suffix(".jpg").read_bytes(), "image/jpeg"),
    }


def jpeg_uri(image: Path | NDArray[np.uint8], maximum_width_px: int = 1600) -> str:
    """Return an image file or an (H, W, 3) uint8 array as a JPEG data URI, shrunk to fit."""
    picture = Image.open(image) if isinstance(image, Path) else Image.fromarray(image)
    picture = picture.convert("RGB")
    if picture.width > maximum_width_px:
        height = round(picture.height * maximum_width_px / picture.width)
        picture = picture.resize((maximum_width_px, height), Image.Resampling.LANCZOS)
    return data_uri(image_file(picture, "JPEG", quality=JPEG_QUALITY), "image/jpeg")
