"""All textures of a scene as mip pyramids in one flat array, for numba kernels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...formats.errors import FileFormatError
from ...formats.scene_bundle import SceneBundle
from .srgb import decode_table, to_linear

MAX_LEVELS = 16


class TexturePack(NamedTuple):
    """Mip pyramids of T textures.

    Attributes:
        texels: (N,) uint32, row 0 = top of the image; 10 bits each of red (lowest), green and blue,
            the square root of linear light. It keeps every sRGB byte apart, decodes by one
            multiplication and fetches a texel in one read.
        offset: (T, MAX_LEVELS) int64 index into `texels` of each level.
        size_px: (T, MAX_LEVELS, 2) int32 width and height of each level.
        levels: (T,) int32 number of levels.
    """

    texels: NDArray[np.uint32]
    offset: NDArray[np.int64]
    size_px: NDArray[np.int32]
    levels: NDArray[np.int32]


@dataclass(frozen=True)
class MaterialTable:
    """What kernels need of M materials.

    Attributes:
        base_linear: (M, 3) float32 base colour in linear light.
        texture: (M,) int32 index into the texture pack, −1 = none.
        pack: the textures.
    """

    base_linear: NDArray[np.float32]
    texture: NDArray[np.int32]
    pack: TexturePack


def load_materials(bundle: SceneBundle) -> MaterialTable:
    """Read a bundle's materials and textures; a texture named twice is stored once.

    Raises:
        FileFormatError: a texture is missing or no image.
    """
    paths = sorted({m.texture for m in bundle.materials if m.texture is not None})
    index = {path: i for i, path in enumerate(paths)}
    base = np.array([m.base_color for m in bundle.materials], dtype=np.float32).reshape(-1, 3)
    return MaterialTable(
        base_linear=to_linear(base),
        texture=np.array(
            [-1 if m.texture is None else index[m.texture] for m in bundle.materials],
            dtype=np.int32,
        ),
        pack=pack_textures([_read_rgb(bundle.root / path) for path in paths]),
    )


def pack_textures(images: list[NDArray[np.uint8]]) -> TexturePack:
    """Build the pyramids of `images`, each (H, W, 3) uint8 sRGB."""
    count = len(images)
    offset = np.zeros((count, MAX_LEVELS), dtype=np.int64)
    size_px = np.ones((count, MAX_LEVELS, 2), dtype=np.int32)
    levels = np.zeros(count, dtype=np.int32)
    chunks: list[NDArray[np.uint32]] = []
    position = 0
    for t, image in enumerate(images):
        for level, mip in enumerate(mip_pyramid(image)):
            offset[t, level] = position
            size_px[t, level] = mip.shape[1], mip.shape[0]
            levels[t] = level + 1
            chunks.append(mip.ravel())
            position += mip.size
    texels = np.concatenate(chunks) if chunks else np.zeros(1, dtype=np.uint32)
    return TexturePack(texels, offset, size_px, levels)


def mip_pyramid(image: NDArray[np.uint8]) -> list[NDArray[np.uint32]]:
    """Halve `image` (H, W, 3) sRGB down to one texel, averaging areas in linear light."""
    roots = np.sqrt(decode_table()) * 1023.0
    mips = [_packed(np.round(roots).astype(np.uint16)[image])]
    linear = decode_table()[image]
    while max(linear.shape[:2]) > 1 and len(mips) < MAX_LEVELS:
        height, width = (max(1, side // 2) for side in linear.shape[:2])
        linear = cv2.resize(linear, (width, height), interpolation=cv2.INTER_AREA)
        linear = linear.reshape(height, width, 3)
        mips.append(_packed(np.round(np.sqrt(linear) * 1023.0)))
    return mips


def _packed(roots: NDArray[np.floating] | NDArray[np.uint16]) -> NDArray[np.uint32]:
    red, green, blue = np.moveaxis(roots.astype(np.uint32), -1, 0)
    return red | green << 10 | blue << 20


def _read_rgb(path: Path) -> NDArray[np.uint8]:
    if not path.is_file():
        raise FileFormatError(path, "missing texture; the scene's repair is incomplete")
    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise FileFormatError(path, "not an image that OpenCV can read; valid: PNG or JPEG")
    return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)
