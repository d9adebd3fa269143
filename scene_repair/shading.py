"""Colours of surface points: base colour times texture, sampled in bulk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .scan import ScanMaterial


class Looks:
    """Materials with their images as arrays, decoded once.

    Args:
        materials: as the mesh's `face_material` numbers them.
    """

    def __init__(self, materials: tuple[ScanMaterial, ...]):
        self.colors = np.array([m.base_color for m in materials], dtype=np.float32)
        self.materials = materials
        self._images: dict[int, NDArray[np.uint8]] = {}

    def _image(self, index: int) -> NDArray[np.uint8] | None:
        image = self.materials[index].image
        if image is None:
            return None
        if index not in self._images:
            self._images[index] = np.asarray(image.convert("RGB"))
        return self._images[index]

    def at(self, material: NDArray[np.int32], uv: NDArray[np.float32]) -> NDArray[np.float32]:
        """SRGB colours (N, 3) in 0–1, bilinear, repeating.

        Args:
            material: (N,) material of each point.
            uv: (N, 2), v up.
        """
        result = self.colors[material]
        for index in np.unique(material):
            pixels = self._image(int(index))
            if pixels is None:
                continue
            mine = material == index
            result[mine] *= _bilinear(pixels, uv[mine]) / 255.0
        return result


def _bilinear(pixels: NDArray[np.uint8], uv: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = pixels.shape[:2]
    # Wrapped first: far from zero single precision would blur.
    x = (uv[:, 0] % 1.0) * width - 0.5
    y = (1.0 - uv[:, 1] % 1.0) * height - 0.5
    x0, y0 = np.floor(x), np.floor(y)
    fx = (x - x0).astype(np.float32)[:, None]
    fy = (y - y0).astype(np.float32)[:, None]
    i0, j0 = y0.astype(np.int32) % height, x0.astype(np.int32) % width
    i1, j1 = (i0 + 1) % height, (j0 + 1) % width
    flat = pixels.reshape(-1, 3)
    result = flat[i0 * width + j0] * ((1 - fy) * (1 - fx))
    result += flat[i0 * width + j1] * ((1 - fy) * fx)
    result += flat[i1 * width + j0] * (fy * (1 - fx))
    result += flat[i1 * width + j1] * (fy * fx)
    return result.astype(np.float32)


def barycentric(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (N, 3) of 2-D points (N, 2) in 2-D triangles (N, 3, 2), clipped to the triangle."""
    a, b, c = (triangles[:, k] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    area = np.where(area == 0, 1e-30, area)
    v = (points[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (points[:, 1] - a[:, 1]) * (
        c[:, 0] - a[:, 0]
    )
    w = (b[:, 0] - a[:, 0]) * (points[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (
        points[:, 0] - a[:, 0]
    )
    weights = np.stack([1 - (v + w) / area, v / area, w / area], axis=1)
    weights = np.clip(weights, 0.0, 1.0)
    return weights / weights.sum(axis=1, keepdims=True)
