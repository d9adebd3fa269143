"""sRGB bytes and linear light (IEC 61966-2-1), as functions and as tables for kernels."""

import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import F32, U8
from ...formats.process.kernel import kernel

ENCODE_STEPS = 4096


def to_linear(srgb: ArrayLike) -> F32:
    """Convert sRGB values in 0…1 of any shape to linear light in 0…1."""
    s = np.asarray(srgb, dtype=np.float32)
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4).astype(np.float32)


def to_srgb(linear: ArrayLike) -> F32:
    """Convert linear light of any shape (clipped to 0…1) to sRGB values in 0…1."""
    x = np.clip(np.asarray(linear, dtype=np.float32), 0.0, 1.0)
    return np.where(x <= 0.0031308, x * 12.92, 1.055 * x ** (1 / 2.4) - 0.055).astype(np.float32)


def decode_table() -> F32:
    """Return the linear light of each sRGB byte, (256,) float32."""
    return to_linear(np.arange(256) / 255.0)


def encode_table() -> U8:
    """Return the sRGB bytes of linear light k / ENCODE_STEPS, (ENCODE_STEPS + 1,) uint8."""
    return np.round(to_srgb(np.arange(ENCODE_STEPS + 1) / ENCODE_STEPS) * 255.0).astype(np.uint8)


@kernel(3)
def encode_srgb(linear: F32, table: U8, out: U8) -> None:
    """Write linear light (N, 3) as sRGB bytes to `out` (N, 3) through `encode_table()`."""
    steps = np.float32(table.shape[0] - 1)
    for i in range(linear.shape[0]):
        for k in range(3):
            x = min(max(linear[i, k], np.float32(0.0)), np.float32(1.0))
            # Unsigned, so that it need not be checked for being negative.
            out[i, k] = table[np.uint64(np.int32(x * steps + np.float32(0.5)))]
