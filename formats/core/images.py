"""Images as the bytes of a file, and as URIs that hold a file."""

import base64
import io
from typing import Any

from PIL import Image


def image_file(image: Image.Image, kind: str, **options: Any) -> bytes:
    """Return an image as the bytes of a file, of Pillow's `kind` such as "PNG" with its options."""
    stream = io.BytesIO()
    image.save(stream, kind, **options)
    return stream.getvalue()


def data_uri(content: bytes, media_type: str) -> str:
    """Return a URI that holds a whole file, such as one of `media_type` "image/png"."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"
