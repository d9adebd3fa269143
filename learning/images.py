"""Images as the training loader gives them, from images as a camera gives them.

In training an image was rendered, encoded, decoded and resized; in closed loop it is rendered and
must be made the same. What is left between the two is the loss of the RGB codec.
"""

import cv2
import numpy as np
import torch
from torch import Tensor

from ..formats.core.arrays import F32, U8, U16

DEPTH_STEP_M = 0.001  # decoded depth is kept in whole millimetres


def to_millimetres(depth_m: F32) -> U16:
    """Return depth [m] in whole millimetres, at most 65535."""
    return np.rint(depth_m / DEPTH_STEP_M).clip(0, 65535).astype(np.uint16)


def rgb_input(rgb: U8, size_px: int) -> Tensor:
    """Return an image (H, W, 3) as (3, size, size) uint8, averaged over areas."""
    if rgb.shape[:2] != (size_px, size_px):
        rgb = np.asarray(
            cv2.resize(rgb, (size_px, size_px), interpolation=cv2.INTER_AREA), np.uint8
        )
    return torch.from_numpy(np.ascontiguousarray(rgb)).permute(2, 0, 1)


def depth_input(depth_m: F32, size_px: int, far_m: float) -> Tensor:
    """Return depth (H, W) [m] as (1, size, size); 0 where it was not measured, or beyond `far_m`.

    Pixels are picked, because the mean of a valid and an invalid depth is meaningless.
    """
    if depth_m.shape != (size_px, size_px):
        depth_m = np.asarray(
            cv2.resize(depth_m, (size_px, size_px), interpolation=cv2.INTER_NEAREST_EXACT),
            np.float32,
        )
    valid = np.isfinite(depth_m) & (depth_m <= far_m)
    return torch.from_numpy(np.where(valid, depth_m, np.float32(0)))[None]
