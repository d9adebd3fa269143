"""Pinhole cameras: intrinsics and mounting."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Array

# Centre of the first pixel at (0, 0), as OpenCV, ROS and Foxglove have it.
PIXEL_CONVENTION = "opencv"


@dataclass(frozen=True)
class CameraModel:
    """An ideal pinhole camera with square pixels and the principal point at the image centre.

    Attributes:
        name: kind of view, or the rig's name; with resolution and light it names the folder.
        hfov_deg: horizontal field of view [deg].
    """

    name: str
    width_px: int
    height_px: int
    hfov_deg: float

    @property
    def focal_px(self) -> float:
        """Return the focal length [px], equal in x and y."""
        return 0.5 * self.width_px / float(np.tan(0.5 * np.deg2rad(self.hfov_deg)))

    @property
    def intrinsics(self) -> Array:
        """Return the intrinsic matrix K (3, 3) in OpenCV's convention.

        Pixel centres lie at whole numbers, so that cx = (width − 1) / 2 and a pixel in column u and
        row v with depth z is the point ((u − cx) z / fx, (v − cy) z / fy, z) of the optical frame.
        """
        f, cx, cy = self.focal_px, 0.5 * (self.width_px - 1), 0.5 * (self.height_px - 1)
        return np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    def pixel_rays(self) -> Array:
        """Return the points (height, width, 3) of the optical frame that pixels show at depth 1."""
        row, column = np.indices((self.height_px, self.width_px))
        x = (column - (self.width_px - 1) / 2) / self.focal_px
        y = (row - (self.height_px - 1) / 2) / self.focal_px
        return np.stack([x, y, np.ones(x.shape)], axis=-1)

    def to_json(self) -> dict[str, Any]:
        """Return the camera as JSON values, sufficient to unproject its pixels."""
        return {
            "name": self.name,
            "width_px": self.width_px,
            "height_px": self.height_px,
            "hfov_deg": self.hfov_deg,
            "intrinsics": self.intrinsics.tolist(),
            "pixel_convention": PIXEL_CONVENTION,
            "frame": "optical: x right, y down, z forward",
        }


@dataclass(frozen=True)
class DepthRange:
    """Clip range of stored depth [m]; readings outside it are stored as 0 (invalid)."""

    near_m: float = 0.05
    far_m: float = 20.0
