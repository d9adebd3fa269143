"""Sample colours of surface points: base colour times texture."""

import cv2
import numpy as np

from ...formats.core.arrays import F32, I32, U8
from ..scan.record import ScanMaterial

ROW = 4096


class MaterialSampler:
    """Materials, as a mesh's `face_material` numbers them, with their images decoded once."""

    def __init__(self, materials: tuple[ScanMaterial, ...]):
        self.colors = np.array([m.base_color for m in materials], dtype=np.float32)
        self.materials = materials
        self._images: dict[int, U8] = {}

    def _image(self, index: int) -> U8 | None:
        image = self.materials[index].image
        if image is None:
            return None
        if index not in self._images:
            self._images[index] = np.ascontiguousarray(image.convert("RGB"))
        return self._images[index]

    def at(self, material: I32, uv: F32) -> F32:
        """Return sRGB (N, 3) in 0–1 of materials (N,) at uv (N, 2), v up; bilinear, repeating."""
        if not len(material):
            return np.zeros((0, 3), dtype=np.float32)
        used = np.flatnonzero(np.bincount(material))
        result = self.colors[material]
        for index in used.tolist():
            pixels = self._image(index)
            if pixels is None:
                continue
            selected = slice(None) if len(used) == 1 else np.flatnonzero(material == index)
            result[selected] *= _bilinear(pixels, uv[selected]) * np.float32(1 / 255)
        return result


def _bilinear(pixels: U8, uv: F32) -> U8:
    """Return colours (N, 3) at (N, 2), interpolated to 1/32 pixel."""
    height, width = pixels.shape[:2]
    # Wrapped first: far from zero single precision would blur.
    at = uv - np.floor(uv)
    x = at[:, 0] * width - 0.5
    y = (1 - at[:, 1]) * height - 0.5
    # In rows, as a picture's sides are limited.
    rows = -(-len(uv) // ROW)
    x, y = (np.resize(a, (rows, ROW)) for a in (x, y))
    sampled = cv2.remap(pixels, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(sampled, dtype=np.uint8).reshape(-1, 3)[: len(uv)]
