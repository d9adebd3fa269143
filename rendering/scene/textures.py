"""Textures of a scene as mip pyramids in one flat array for kernels."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...formats.core.arrays import F32, I32, U8
from ...formats.core.errors import FileFormatError
from ...formats.scene.bundle import SceneBundle
from ..kernels.data import TexturePack
from ..kernels.srgb import decode_table, to_linear

MAX_LEVELS = 16
STRIP_ROWS = 256
MAX_TEXELS = 96_000_000  # 512 MB with all mip levels

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MaterialTable:
    """M materials as arrays.

    Attributes:
        base_linear: (M, 3) float32 base colour in linear light.
        texture: (M,) int32 index into the texture pack, −1 = none.
    """

    base_linear: F32
    texture: I32
    pack: TexturePack


def load_materials(bundle: SceneBundle, max_texels: int = MAX_TEXELS) -> MaterialTable:
    """Read a bundle's materials and textures; a texture used twice is stored once.

    If a scene has more than `max_texels` texels, its textures are halved, the largest first, until
    they fit, because several renderers must fit into memory.

    Raises:
        FileFormatError: a texture is missing or not an image.
    """
    paths = sorted({m.texture for m in bundle.materials if m.texture is not None})
    index = {path: i for i, path in enumerate(paths)}
    base = np.array([m.base_color for m in bundle.materials], dtype=np.float32).reshape(-1, 3)
    files = [bundle.root / path for path in paths]
    skips = levels_to_skip([_image_size(file) for file in files], max_texels)
    if any(skips):
        log.warning("%s: %d of %d textures reduced to fit into memory", bundle.scene_id,
                    sum(skip > 0 for skip in skips), len(skips))  # fmt: skip
    return MaterialTable(
        base_linear=to_linear(base),
        texture=np.array(
            [-1 if m.texture is None else index[m.texture] for m in bundle.materials],
            dtype=np.int32,
        ),
        pack=pack_textures(
            mip_pyramid(_read_rgb(file))[skip:] for file, skip in zip(files, skips, strict=True)
        ),
    )


def levels_to_skip(sizes_px: list[tuple[int, int]], max_texels: int) -> list[int]:
    """Return how often to halve each texture so that all have at most `max_texels` texels."""
    skips = [0] * len(sizes_px)
    texels = [width * height for width, height in sizes_px]
    while sum(texels) > max_texels and max(texels) > 1:
        largest = max(texels)
        for i, count in enumerate(texels):
            if count == largest:
                skips[i] += 1
                texels[i] = max(1, count // 4)
    return skips


def pack_textures(pyramids: Iterable[list[NDArray[np.uint32]]]) -> TexturePack:
    """Pack pyramids from `mip_pyramid` one after the other."""
    offsets, sizes, levels = [], [], []
    chunks: list[NDArray[np.uint32]] = []
    position = 0
    for mips in pyramids:
        offset = np.zeros(MAX_LEVELS, dtype=np.int64)
        size_px = np.ones((MAX_LEVELS, 2), dtype=np.int32)
        for level, mip in enumerate(mips):
            offset[level] = position
            size_px[level] = mip.shape[1], mip.shape[0]
            height, width = mip.shape
            wrapped = np.empty((height + 1, width + 1), dtype=np.uint32)
            wrapped[:height, :width], wrapped[height, :width] = mip, mip[0]
            wrapped[:, width] = wrapped[:, 0]
            chunks.append(wrapped.ravel())
            position += wrapped.size
        offsets.append(offset)
        sizes.append(size_px)
        levels.append(len(mips))
    return TexturePack(
        np.concatenate(chunks) if chunks else np.zeros(1, dtype=np.uint32),
        np.array(offsets, dtype=np.int64).reshape(-1, MAX_LEVELS),
        np.array(sizes, dtype=np.int32).reshape(-1, MAX_LEVELS, 2),
        np.array(levels, dtype=np.int32),
    )


def mip_pyramid(image: U8) -> list[NDArray[np.uint32]]:
    """Halve `image` (H, W, 3) sRGB down to one texel, averaging areas in linear light."""
    decode = decode_table()
    roots = np.round(np.sqrt(decode) * 1023.0).astype(np.uint32)
    first = roots[image[..., 0]]
    for channel, shift in ((1, 10), (2, 20)):
        first |= (roots << np.uint32(shift))[image[..., channel]]
    mips = [first]
    linear = None
    while max(mips[-1].shape) > 1 and len(mips) < MAX_LEVELS:
        linear = _halve_bytes(image, decode) if linear is None else _halve(linear)
        mips.append(_packed(linear))
    return mips


def _halve(linear: F32) -> F32:
    height, width = (max(1, side // 2) for side in linear.shape[:2])
    small = cv2.resize(linear, (width, height), interpolation=cv2.INTER_AREA)
    return small.reshape(height, width, 3).astype(np.float32, copy=False)


def _halve_bytes(image: U8, decode: F32) -> F32:
    """Halve an image in strips of rows, because as floats it takes four times the memory."""
    if image.shape[0] % 2:
        return _halve(decode[image])
    strips = [_halve(decode[image[r : r + STRIP_ROWS]]) for r in range(0, len(image), STRIP_ROWS)]
    return np.concatenate(strips)


def _packed(linear: F32) -> NDArray[np.uint32]:
    packed = np.zeros(linear.shape[:2], dtype=np.uint32)
    for channel, shift in enumerate((0, 10, 20)):
        roots = np.round(np.sqrt(linear[..., channel]) * 1023.0).astype(np.uint32)
        packed |= roots << np.uint32(shift)
    return packed


def _image_size(path: Path) -> tuple[int, int]:
    if not path.is_file():
        raise FileFormatError(path, "the texture is missing; repair the scene again")
    try:
        with Image.open(path) as image:  # reads the header only
            return image.size
    except (OSError, ValueError) as error:
        raise FileFormatError(path, "the texture is not an image; valid: PNG or JPEG") from error


def _read_rgb(path: Path) -> U8:
    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise FileFormatError(path, "the texture is damaged; repair the scene again")
    return np.asarray(image, dtype=np.uint8)
