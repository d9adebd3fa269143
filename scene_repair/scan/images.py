"""Decode untrusted images in bounded memory, or skip them with a warning."""

import io
import warnings as python_warnings
from dataclasses import dataclass

import numpy as np
from PIL import Image

from ...formats.core.errors import first_line

# Larger pictures are scaled down while they are decoded.
MAX_PIXELS, MAX_SIDE = 64_000_000, 4096
# All but plain JPEG is decoded as a whole before it is scaled down; 16,384 × 16,384 is in use.
MAX_WHOLE_PIXELS = 300_000_000
# All pictures of one scan together.
MAX_TOTAL_PIXELS = 256_000_000
# As many pixels are decoded at most for one scan, before anything is scaled down.
MAX_SOURCE_PIXELS = 8_000_000_000
# Pillow passes some other formats to external programs. Phones write JPEG that it calls MPO.
FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TIFF", "GIF", "TGA")


@dataclass
class PixelBudget:
    """Number of encoded pixels that may still be decoded for one scan."""

    left: int = MAX_SOURCE_PIXELS

    def take(self, width: int, height: int) -> None:
        """Deduct one image; raise ValueError if there are not so many pixels left."""
        if width * height > self.left:
            raise ValueError(
                f"the scan's images have more than {MAX_SOURCE_PIXELS:,} pixels in total"
            )
        self.left -= width * height


def open_image(
    data: bytes, name: str, warnings: list[str], budget: PixelBudget
) -> Image.Image | None:
    """Return an image within the limits, large ones decoded; None and a warning if unusable."""
    try:
        return _open(data, name, warnings, budget)
    # Pillow's readers raise many types on damaged bytes.
    except Exception as error:
        warnings.append(f"picture {name} cannot be read ({first_line(error)}); its colour is used")
        return None


def _open(data: bytes, name: str, warnings: list[str], budget: PixelBudget) -> Image.Image:
    with python_warnings.catch_warnings():
        # The size is looked at here, before anything is decoded.
        python_warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            image = Image.open(io.BytesIO(data), formats=FORMATS)
        finally:
            Image.MAX_IMAGE_PIXELS = limit
    width, height = image.size
    budget.take(width, height)
    if width * height <= MAX_PIXELS:
        return image
    if image.format not in ("PNG", "JPEG"):
        raise ValueError(f"{width} × {height} pixels are too many for {image.format}")
    whole = image.format == "PNG" or image.info.get("progressive")
    if whole and width * height > MAX_WHOLE_PIXELS:
        raise ValueError(f"{width} × {height} pixels are too many to be decoded as a whole")
    scale = MAX_SIDE / max(width, height)
    image.draft("RGB", (max(1, int(width * scale)), max(1, int(height * scale))))
    small = _rgb(image)
    small.thumbnail((MAX_SIDE, MAX_SIDE))
    small.format = image.format
    warnings.append(
        f"picture {name} of {width} × {height} pixels scaled down to {small.width} × {small.height}"
    )
    return small


def decode_all(
    images: dict[str, Image.Image], warnings: list[str]
) -> dict[str, Image.Image | None]:
    """Decode images to RGB, scaled down beyond the total pixel limit; damaged ones become None."""
    total = sum(image.width * image.height for image in images.values())
    scale = min(1.0, (MAX_TOTAL_PIXELS / max(total, 1)) ** 0.5)
    if scale < 1.0:
        warnings.append(
            f"{len(images)} pictures of {total / 1e6:.0f} million pixels together scaled down to "
            f"{100 * scale:.0f} %"
        )
    return {name: _decode(image, name, scale, warnings) for name, image in images.items()}


def _decode(image: Image.Image, name: str, scale: float, warnings: list[str]) -> Image.Image | None:
    kind = image.format
    try:
        if kind is not None and kind not in (*FORMATS, "MPO"):
            raise ValueError(f"{kind} is not supported; valid: {', '.join(FORMATS)}")
        picture = _rgb(image)
    except Exception as error:
        warnings.append(f"picture {name} is damaged ({first_line(error)}); its colour is used")
        return None
    if scale < 1.0:
        size = (max(1, int(picture.width * scale)), max(1, int(picture.height * scale)))
        picture = picture.resize(size, Image.Resampling.BOX)
    picture.format = kind
    return picture


def _rgb(image: Image.Image) -> Image.Image:
    if image.mode.startswith("I") or image.mode == "F":
        # Sixteen bits; Pillow would clip them to eight.
        image = Image.fromarray((np.asarray(image).astype(np.int64) >> 8).astype(np.uint8))
    return image.convert("RGB")
