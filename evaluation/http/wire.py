"""Messages of `POST /eval_dual`: images and JSON in a multipart form, a JSON object as the reply.

The form has the fields `image` (JPEG), `depth` (PNG, uint16 in 0.1 mm, 0 = not measured) and
`json`. `{"reset": true}` in the latter begins an episode. vlnpe also sends `instruction`, `idx`
(the number of actions so far) and `pose` (x, y [m], yaw [rad] from the start), which InternNav's
own server ignores. The reply holds `discrete_action`, a list of 0 STOP, 1 FORWARD, 2 LEFT, 3 RIGHT,
or `trajectory`, points (x forward, y left [m]) in the frame of the robot when the image was taken.
"""

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...formats.core.images import image_file

PATH = "/eval_dual"
DEPTH_UNIT_M = 1e-4
FARTHEST_DEPTH_M = 65535 * DEPTH_UNIT_M
JPEG_QUALITY = 95
LARGEST_IMAGE_PX = 1 << 24


def form_of(
    rgb: NDArray[np.uint8], depth_m: NDArray[np.float32]
) -> dict[str, tuple[str, bytes, str]]:
    """Return the form's two files.

    Args:
        rgb: (H, W, 3) sRGB.
        depth_m: (H, W) planar z [m], 0 = not measured; beyond 6.5535 m it is sent as that.
    """
    codes = np.rint(np.clip(depth_m, 0.0, FARTHEST_DEPTH_M) / DEPTH_UNIT_M).astype(np.uint16)
    return {
        "image": (
            "rgb.jpg",
            image_file(Image.fromarray(rgb), "JPEG", quality=JPEG_QUALITY),
            "image/jpeg",
        ),
        "depth": ("depth.png", image_file(Image.fromarray(codes), "PNG"), "image/png"),
    }


def images_in(image: bytes, depth: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return RGB (H, W, 3) uint8 and depth (H, W) float32 [m] of a form.

    Raises:
        ValueError: a file is no image, is too large, or they differ in size.
    """
    rgb = np.asarray(_opened(image, "image").convert("RGB"))
    codes = np.asarray(_opened(depth, "depth"))
    if codes.ndim != 2 or codes.dtype.kind not in "ui":
        raise ValueError("depth: a PNG of another kind; valid: one channel of 16 bits, in 0.1 mm")
    if codes.shape != rgb.shape[:2]:
        raise ValueError(f"depth is of size {codes.shape}, image of {rgb.shape[:2]}")
    return rgb, (codes * DEPTH_UNIT_M).astype(np.float32)


def _opened(data: bytes, name: str) -> Image.Image:
    try:
        image = Image.open(io.BytesIO(data), formats=("JPEG", "PNG"))
        if image.width * image.height > LARGEST_IMAGE_PX:
            raise ValueError(f"{name}: {image.width} x {image.height} px are too many")
        image.load()
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{name}: neither a JPEG nor a PNG ({error!s:.200})") from error
    return image
