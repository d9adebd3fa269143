"""Between sRGB bytes and linear light (IEC 61966-2-1), as tables that numba kernels can use."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ENCODE_STEPS = 4096


def to_linear(srgb: ArrayLike) -> NDArray[np.float32]:
    """SRGB values in 0…1 to linear light in 0…1, any shape."""
    s = np.asarray(srgb, dtype=np.float32)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_srgb(linear: ArrayLike) -> NDArray[np.float32]:
    """Linear light (clipped to 0…1) to sRGB values in 0…1, any shape."""
    x = np.clip(np.asarray(linear, dtype=np.float32), 0.0, 1.0)
    return np.where(x <= 0.0031308, x * 12.92, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def decode_table() -> NDArray[np.float32]:
    """(256,) float32: linear light of each sRGB byte."""
    return to_linear(np.arange(256) / 255.0)


def encode_table() -> NDArray[np.uint8]:
    """(ENCODE_STEPS + 1,) uint8: sRGB byte of linear light k / ENCODE_STEPS."""
    return np.round(to_srgb(np.arange(ENCODE_STEPS + 1) / ENCODE_STEPS) * 255.0).astype(np.uint8)
