"""Tileable noise and colour helpers for procedural textures."""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ...formats.core.arrays import U8, Floats

Field = Floats
Image = U8


def noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int]) -> Field:
    """Smooth noise of unit variance, (rows, columns), that tiles; `cells` bumps along y and x."""
    rows, columns = shape
    cy, cx = min(cells[0], rows), min(cells[1], columns)
    grid = np.pad(rng.standard_normal((cy, cx), dtype=np.float32), 2, mode="wrap")
    x = ((np.arange(columns) + 0.5) * cx / columns + 1.5).astype(np.float32)
    y = ((np.arange(rows) + 0.5) * cy / rows + 1.5).astype(np.float32)
    # Separable resampling is several times faster than a dense remap.
    wide = cv2.remap(grid, np.tile(x, (cy + 4, 1)), _rows(cy + 4, columns), cv2.INTER_CUBIC)
    full = cv2.remap(
        np.ascontiguousarray(wide.T),
        np.tile(y, (columns, 1)),
        _rows(columns, rows),
        cv2.INTER_CUBIC,
    ).T
    return np.ascontiguousarray(full / max(float(full.std()), 1e-6), dtype=np.float32)


def _rows(rows: int, columns: int) -> Field:
    return np.repeat(np.arange(rows, dtype=np.float32)[:, None], columns, axis=1)


def fractal(
    rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int], octaves: int = 4
) -> Field:
    """Return the sum of octaves of `noise`, unit variance."""
    total = np.zeros(shape, dtype=np.float32)
    for k in range(octaves):
        total += noise(rng, shape, (cells[0] << k, cells[1] << k)) * np.float32(0.55**k)
    return total / max(float(total.std()), 1e-6)


def grain(rng: np.random.Generator, shape: tuple[int, int], sharpness: float = 1.0) -> Field:
    """Return the per-pixel noise."""
    return rng.standard_normal(shape, dtype=np.float32) * np.float32(sharpness)


def colored(base: ArrayLike, factor: Field) -> Floats:
    """Return (rows, columns, 3) float image of colour `base` (0–255) times `factor`."""
    return np.asarray(base, dtype=np.float32) * factor[..., None]


def blend(a: Floats | ArrayLike, b: Floats | ArrayLike, weight: Field) -> Floats:
    """Return `a` where `weight` is 0, `b` where it is 1."""
    w = weight[..., None]
    return np.asarray(a, dtype=np.float32) * (1 - w) + np.asarray(b, dtype=np.float32) * w


def to_image(color: Floats) -> Image:
    """Clip to 8 bits."""
    return np.clip(color, 0, 255).astype(np.uint8)


def canvas(shape: tuple[int, int], color: ArrayLike) -> Floats:
    """Return a float image of one colour."""
    return np.broadcast_to(np.asarray(color, dtype=np.float32), (*shape, 3)).copy()
