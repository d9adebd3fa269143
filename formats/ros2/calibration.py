"""The calibration of a log's camera, and the ideal camera that its images are turned into."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.camera import CameraModel
from ..core.errors import FileFormatError

_MODELS = ("plumb_bob", "rational_polynomial", "")
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)
_MOST_PX = 8192


def add_if_new(infos: list[Any], info: Any) -> None:
    """Keep the first CameraInfo of a topic, and the first that says something else."""
    if len(infos) < 2 and all(_told(known) != _told(info) for known in infos):
        infos.append(info)


def check_calibration(path: Path, topic: str, infos: Sequence[Any], frame: str) -> Any:
    """Return the calibration of the camera whose images have the frame, and become a video.

    Raises:
        FileFormatError: If it does not fit, or sizes are odd.
    """
    fault, (width, height) = fault_of(infos, frame), (infos[0].width, infos[0].height)
    if not fault and (width % 2 or height % 2):
        fault = f"images of {width} × {height}; valid: even sizes"
    if fault:
        raise FileFormatError(path, f"{topic}: {fault}")
    return infos[0]


def fault_of(infos: Sequence[Any], frame: str) -> str:
    """Return why what `add_if_new` kept is no calibration of images that have the frame, or ""."""
    info = infos[0]
    width, height, k, d = info.width, info.height, np.reshape(info.k, (3, 3)), info.d
    if len(infos) > 1:
        return "the calibration changes; valid: one camera, as it was"
    if not (min(width, height) >= 2 and max(width, height) <= _MOST_PX):
        return f"images of {width} × {height}; valid: 2 to {_MOST_PX} pixels"
    if not (np.isfinite(k).all() and np.isfinite(d).all() and k[0, 0] > 0 and k[1, 1] > 0):
        focal = f"focal lengths {k[0, 0]:g} and {k[1, 1]:g}, distortion {np.round(d, 4).tolist()}"
        return f"the camera is not calibrated: {focal}"
    if info.distortion_model not in _MODELS or len(d) not in _COEFFICIENTS:
        model = f"distortion model {info.distortion_model!r} with {len(d)} coefficients"
        return f"{model}; valid: plumb_bob, rational_polynomial"
    own = info.header.frame_id
    if own and frame and own != frame:
        return f"a calibration of {own}, but images of {frame}; valid: one camera"
    return ""


def of_rectified(info: Any) -> Any:
    """Return the CameraInfo of images that `image_proc` straightened by a CameraInfo.

    Its projection is theirs; where it holds none, they kept the camera's own intrinsics.
    """
    p = np.reshape(info.p, (3, 4))[:, :3]
    told = np.isfinite(p).all() and p[0, 0] > 0 and p[1, 1] > 0
    return replace(info, d=np.zeros(0), k=p.ravel() if told else info.k)


def same_pixels(info: Any, other: Any) -> bool:
    """Return whether two calibrations in one frame say the same of every pixel."""
    sizes = (info.width, info.height) == (other.width, other.height)
    bent, bent_other = (np.pad(c.d, (0, _COEFFICIENTS[-1] - len(c.d))) for c in (info, other))
    return sizes and np.allclose(info.k, other.k, atol=1e-3) and np.array_equal(bent, bent_other)


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
    """Maps the pixels of a calibrated camera to those of an ideal one in its place.

    Attributes:
        size_px: Width and height of the images that it takes.
    """

    def __init__(self, info: Any, camera: CameraModel):
        self.size_px, size = (info.width, info.height), (camera.width_px, camera.height_px)
        k, self._maps = np.reshape(info.k, (3, 3)), None
        same = self.size_px == size and np.allclose(k, camera.intrinsics, atol=1e-3)
        if not same or np.any(info.d):
            self._maps = cv2.initUndistortRectifyMap(
                k, np.array(info.d), np.eye(3), camera.intrinsics, size, cv2.CV_32FC1
            )

    def __call__(self, image: NDArray[Any], interpolation: int) -> NDArray[Any]:
        """Return an image (H, W, …); pixels that the camera does not see are 0."""
        if self._maps is None:
            return image
        return cv2.remap(image, *self._maps, interpolation)


def _told(info: Any) -> tuple[Any, ...]:
    return info.width, info.height, info.distortion_model, info.k.tobytes(), info.d.tobytes()
