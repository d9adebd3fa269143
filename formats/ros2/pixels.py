"""Images of a robot's log: decoded, and as an ideal camera would show them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.camera import CameraModel
from ..core.errors import FileFormatError
from .bag import STORE
from .tracks import header_stamp, messages

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


def ideal_camera(info: Any) -> CameraModel:
    """Return the pinhole camera with square pixels that sees what a calibrated one does."""
    return CameraModel(
        "ego",
        info.width,
        info.height,
        # Without the noise of the last digits, a simulated camera comes back.
        round(float(np.rad2deg(2 * np.arctan(0.5 * info.width / info.k[0]))), 9),
    )


class Straightener:
    """Maps the pixels of a calibrated camera to those of its ideal one."""

    def __init__(self, path: Path, info: Any):
        if info.distortion_model not in ("plumb_bob", "rational_polynomial", ""):
            reason = f"distortion model {info.distortion_model!r}; valid: plumb_bob, "
            raise FileFormatError(path, f"{reason}rational_polynomial")
        size, camera = (info.width, info.height), ideal_camera(info)
        k, self._maps = np.reshape(info.k, (3, 3)), None
        if not np.allclose(k, camera.intrinsics, atol=1e-3) or np.any(info.d):
            self._maps = cv2.initUndistortRectifyMap(
                k, np.array(info.d), np.eye(3), camera.intrinsics, size, cv2.CV_32FC1
            )

    def __call__(self, image: NDArray[Any], interpolation: int) -> NDArray[Any]:
        """Return an image (H, W, …); pixels that the camera does not see are 0."""
        if self._maps is None:
            return image
        return cv2.remap(image, *self._maps, interpolation)


def images(
    path: Path, topic: str, stamps: NDArray[np.int64], info: Any, *, depth: bool
) -> Iterator[NDArray[Any]]:
    """Yield colour (H, W, 3) uint8, or depth (H, W) float32 [m], of the wanted messages.

    Args:
        stamps: (N,) number of each image among the topic's different stamps, ascending, repeated
            where one image serves several frames.

    Raises:
        FileFormatError: If an image is damaged, or the stamps run backwards.
    """
    straighten = Straightener(path, info)
    decode = _depth if depth else _color
    done, number, last = 0, -1, None
    for name, kind, _, data in messages(path, (topic,)):
        stamp, _frame = header_stamp(data)
        if last is not None and stamp < last:
            raise FileFormatError(path, f"{name}: image {number + 1} is older than the one before")
        if stamp == last:
            continue
        number, last = number + 1, stamp
        if done < len(stamps) and stamps[done] == number:
            message: Any = STORE.deserialize_cdr(data, kind)
            try:
                image = decode(message)
            except (ValueError, KeyError, cv2.error) as error:
                reason = f"{name}: image {number} is damaged: {error}"
                raise FileFormatError(path, reason) from error
            if image.shape[:2] != (info.height, info.width):
                size = f"{image.shape[1]} × {image.shape[0]} px"
                reason = f"{size}; its calibration has {info.width} × {info.height}"
                raise FileFormatError(path, f"{name}: image {number} has {reason}")
            image = straighten(image, cv2.INTER_NEAREST if depth else cv2.INTER_LINEAR)
            while done < len(stamps) and stamps[done] == number:
                yield image
                done += 1
        if done == len(stamps):
            return
    if done < len(stamps):
        raise FileFormatError(path, f"{topic}: image {stamps[done]} is missing")


def _color(message: Any) -> NDArray[np.uint8]:
    if hasattr(message, "format"):
        image = cv2.imdecode(message.data, cv2.IMREAD_COLOR)
        if image is None:
            raise ValueError(f"not a {message.format} image")
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)  # pyright: ignore[reportReturnType]
    if message.encoding not in _COLORS:
        raise ValueError(f"encoding {message.encoding!r}; valid: {', '.join(_COLORS)}")
    image, conversion = _rows(message, np.dtype("u1")), _COLORS[message.encoding]
    image = image.reshape(message.height, message.width, -1)
    image = image if conversion is None else cv2.cvtColor(image, conversion)
    return np.ascontiguousarray(image)


def _depth(message: Any) -> NDArray[np.float32]:
    if hasattr(message, "format"):
        data = message.data
        if "compressedDepth" in message.format:
            data = data[_DEPTH_HEADER_BYTES:]
        image, scale = cv2.imdecode(data, cv2.IMREAD_UNCHANGED), 0.001
        if image is None or image.dtype != np.uint16 or image.ndim != 2:
            raise ValueError(f"{message.format!r} is no PNG of 16-bit millimetres")
    else:
        if message.encoding not in _DEPTHS:
            raise ValueError(f"encoding {message.encoding!r}; valid: {', '.join(_DEPTHS)}")
        kind, scale = _DEPTHS[message.encoding]
        order = ">" if message.is_bigendian else "<"
        image = _rows(message, np.dtype(order + kind))
    return (image * np.float32(scale)).astype(np.float32)


def _rows(message: Any, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return the pixels row by row, without the padding behind each row."""
    if len(message.data) != message.height * message.step:
        raise ValueError(f"{len(message.data)} bytes of {message.height} × {message.step}")
    rows = np.asarray(message.data).reshape(message.height, message.step)
    channels = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4}.get(message.encoding, 1)
    return np.ascontiguousarray(rows[:, : message.width * channels * kind.itemsize]).view(kind)
