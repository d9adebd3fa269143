"""Images of a robot's log: decoded, and as an ideal camera would show them."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from ..core.errors import FileFormatError, one_line
from .bag import NANOSECONDS, STORE
from .calibration import Straightener
from .log import BAG_ERRORS, messages, stamp_lead_ns
from .topic_map import KINDS

_COLORS = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
}
_DEPTHS = {"16UC1": ("u2", 0.001), "mono16": ("u2", 0.001), "32FC1": ("f4", 1.0)}
# compressedDepth begins with a format and two parameters of its own.
_DEPTH_HEADER_BYTES = 12


def images(
    path: Path,
    topic: str,
    times_ns: NDArray[np.int64],
    straighten: Straightener,
    *,
    depth: bool,
) -> Iterator[NDArray[Any]]:
    """Yield colour (H, W, 3) uint8, or depth (H, W) float32 [m], of chosen messages.

    Args:
        times_ns: (N, 2) log time of each image, ascending, and its stamp less that [ns]; repeated
            where one image serves several frames.

    Raises:
        FileFormatError: If an image is damaged or missing.
    """
    decode, done = _depth if depth else _color, 0
    span_ns, chosen = (int(times_ns[0, 0]), int(times_ns[-1, 0]) + 1), times_ns.tolist()
    for name, kind, at, data in messages(path, {topic: KINDS["color"]}, span_ns=span_ns):
        times = [at, stamp_lead_ns(data, at)]
        if done == len(chosen) or times != chosen[done]:
            continue
        seconds = f"{name}: the image {(at - span_ns[0]) / NANOSECONDS:.2f} s after the first one"
        try:
            image = decode(STORE.deserialize_cdr(data, kind), straighten.size_px)
        except (*BAG_ERRORS, cv2.error) as error:
            raise FileFormatError(path, f"{seconds} is damaged: {one_line(error)}") from error
        image = straighten(image, cv2.INTER_NEAREST if depth else cv2.INTER_LINEAR)
        while done < len(chosen) and times == chosen[done]:
            yield image
            done += 1
    if done < len(chosen):
        raise FileFormatError(path, f"{topic}: {len(chosen) - done} images are missing")


def _color(message: Any, size: tuple[int, int]) -> NDArray[np.uint8]:
    if hasattr(message, "format"):
        image = _decoded(message, message.data, cv2.IMREAD_COLOR, size)
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)  # pyright: ignore[reportReturnType]
    if message.encoding not in _COLORS:
        raise ValueError(f"encoding {message.encoding!r}; valid: {', '.join(_COLORS)}")
    image, conversion = _rows(message, np.dtype("u1"), size), _COLORS[message.encoding]
    image = image.reshape(message.height, message.width, -1)
    image = image if conversion is None else cv2.cvtColor(image, conversion)
    return np.ascontiguousarray(image)


def _depth(message: Any, size: tuple[int, int]) -> NDArray[np.float32]:
    if hasattr(message, "format"):
        data = message.data
        if "compressedDepth" in message.format:
            data = data[_DEPTH_HEADER_BYTES:]
        image, scale = _decoded(message, data, cv2.IMREAD_UNCHANGED, size), 0.001
        # Of 32FC1, compressedDepth keeps codes of inverse depth.
        if image.dtype != np.uint16 or image.ndim != 2 or message.format.startswith("32FC1"):
            raise ValueError(f"{message.format!r} is no PNG of 16-bit millimetres")
    else:
        if message.encoding not in _DEPTHS:
            raise ValueError(f"encoding {message.encoding!r}; valid: {', '.join(_DEPTHS)}")
        kind, scale = _DEPTHS[message.encoding]
        order = ">" if message.is_bigendian else "<"
        image = _rows(message, np.dtype(order + kind), size)
    return (image * np.float32(scale)).astype(np.float32)


def _decoded(message: Any, data: Any, flags: int, size: tuple[int, int]) -> NDArray[Any]:
    """Return a compressed picture; its size is checked first, for a small file may hold gigabytes.

    Raises:
        ValueError: If it is damaged, or not of the size that the calibration has.
    """
    try:
        with Image.open(io.BytesIO(bytes(data))) as picture:
            own = picture.size
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise ValueError(f"not an image of format {message.format!r}") from error
    _check_size(own, size)
    image = cv2.imdecode(data, flags)
    if image is None:
        raise ValueError(f"an incomplete image of format {message.format!r}")
    return image


def _check_size(own: tuple[int, int], size: tuple[int, int]) -> None:
    if own != size:
        shape = f"{own[0]} × {own[1]} px"
        raise ValueError(f"{shape}; its calibration has {size[0]} × {size[1]}")


def _rows(message: Any, kind: np.dtype[Any], size: tuple[int, int]) -> NDArray[Any]:
    """Return the pixels row by row, without the padding behind each row."""
    _check_size((message.width, message.height), size)
    channels = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}.get(message.encoding, 1)
    row_bytes = message.width * channels * kind.itemsize
    if len(message.data) != message.height * message.step or message.step < row_bytes:
        raise ValueError(f"{len(message.data)} bytes of {message.height} × {message.step}")
    rows = np.asarray(message.data).reshape(message.height, message.step)
    return np.ascontiguousarray(rows[:, :row_bytes]).view(kind)
