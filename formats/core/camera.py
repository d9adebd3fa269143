"""Pinhole cameras: intrinsics and mounting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class CameraModel:
    """An ideal pinhole camera with square pixels and the principal point at the image centre.

    Attributes:
        name: view name; together with resolution and light it names the output folder.
        width_px, height_px: image size.
        hfov_deg: horizontal field of view [deg].
    """

    name: str
    width_px: int
    height_px: int
    hfov_deg: float

    @property
    def focal_px(self) -> float:
        """Focal length [px], equal in x and y."""
        return 0.5 * self.width_px / float(np.tan(0.5 * np.deg2rad(self.hfov_deg)))

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """K, (3, 3). Pixel centres lie at integer + 0.5, so that cx = width / 2."""
        f = self.focal_px
        return np.array(
            [[f, 0.0, 0.5 * self.width_px], [0.0, f, 0.5 * self.height_px], [0.0, 0.0, 1.0]]
        )


@dataclass(frozen=True)
class DepthRange:
    """Clip range of stored depth [m]; readings outside it are stored as 0 (invalid)."""

    near_m: float = 0.05
    far_m: float = 20.0
