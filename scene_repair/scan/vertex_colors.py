"""Colours at vertices, baked into a texture, so that every surface is drawn alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

# A triangle's tile: corners sit at texel centres (1, 1), (2, 1), (1, 2) of 4 × 4 texels; the
# ring around them keeps coarser filters inside the tile.
TILE = 4
BLOCK = 65_536
# One image holds no more, so that it stays within the size at which textures are scaled down.
MAX_FACES = (4096 // TILE) ** 2


def bake_corner_colors(colors: NDArray[np.uint8]) -> tuple[Image.Image, NDArray[np.float32]]:
    """Bake linear colour ramps over triangles into one image.

    Bilinear lookup between three texel centres is the barycentric ramp, if the fourth texel
    continues the plane through the three.

    Args:
        colors: (F, 3, 3) sRGB of each corner.

    Returns:
        The image, and corner uv (F, 3, 2), v up.
    """
    count = len(colors)
    columns = max(1, int(np.ceil(np.sqrt(count))))
    rows = -(-count // columns)
    sheet = np.zeros((rows * columns, TILE, TILE, 3), dtype=np.uint8)
    # In blocks: as numbers with fractions the whole sheet would be ten times larger.
    for start in range(0, count, BLOCK):
        tiles = _tiles(colors[start : start + BLOCK])
        sheet[start : start + len(tiles)] = tiles
    pixels = sheet.reshape(rows, columns, TILE, TILE, 3).swapaxes(1, 2)
    pixels = pixels.reshape(rows * TILE, columns * TILE, 3)
    index = np.arange(count)
    origin = np.stack([index % columns, index // columns], axis=-1) * TILE
    texel = origin[:, None, :] + np.array([[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]])
    uv = texel / (columns * TILE, rows * TILE)
    uv[..., 1] = 1.0 - uv[..., 1]
    return Image.fromarray(pixels), uv.astype(np.float32)


def _tiles(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tiles (n, TILE, TILE, 3) of triangles with corner colours (n, 3, 3)."""
    corner = colors.astype(np.float32)
    steps = np.arange(TILE, dtype=np.float32) - 1
    across = (corner[:, 1] - corner[:, 0])[:, None, None]
    down = (corner[:, 2] - corner[:, 0])[:, None, None]
    tile = corner[:, 0][:, None, None] + across * steps[None, None, :, None]
    tile = tile + down * steps[None, :, None, None]
    return np.clip(np.rint(tile), 0, 255).astype(np.uint8)
