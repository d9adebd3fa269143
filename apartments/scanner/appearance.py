"""Sample the colour of the exact surface."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I32, I64, U8, Mask
from ...formats.process.kernel import kernel
from ..building.true_scene import TrueScene


@dataclass(frozen=True)
class Appearance:
    """All images in one buffer, and the triangles' texture coordinates.

    Attributes:
        pixels: (P, 3) uint8, the images' rows one after the other.
        layout: (M, 3) int64: first pixel, rows, columns.
        size_m: (M, 2) float32 width and height that an image covers.
        emissive: (M,) bool.
        mean: (M, 3) float32 mean colour, 0–1.
        uv: (F, 3, 2) float32 [m].
        material: (F,) int32.
    """

    pixels: U8
    layout: I64
    size_m: F32
    emissive: Mask
    mean: F32
    uv: F32
    material: I32

    @staticmethod
    def of(scene: TrueScene) -> "Appearance":
        """Collect the materials of `scene`."""
        materials = scene.materials
        counts = [m.image.shape[0] * m.image.shape[1] for m in materials]
        starts = np.r_[0, np.cumsum(counts)[:-1]]
        return Appearance(
            np.concatenate([m.image.reshape(-1, 3) for m in materials]),
            np.array([[s, *m.image.shape[:2]] for s, m in zip(starts, materials, strict=True)]),
            np.array([m.size_m for m in materials], dtype=np.float32),
            np.array([m.emissive for m in materials]),
            np.array([m.image[::7, ::7].mean((0, 1)) / 255 for m in materials], dtype=np.float32),
            scene.shape.uv.astype(np.float32),
            scene.shape.material.astype(np.int32),
        )

    def color(self, face: I32, bary: F32) -> U8:
        """Return colours (N, 3) uint8 at `bary` (N, 2) of triangles `face` (N,); black where −1."""
        return _sample(face, bary, self.uv, self.material, self.pixels, self.layout, self.size_m)


@kernel()
def _sample(face, bary, uv, material, pixels, layout, size_m):
    out = np.zeros((face.shape[0], 3), dtype=np.uint8)
    for i in range(face.shape[0]):
        f = face[i]
        if f < 0:
            continue
        m = material[f]
        b, c = bary[i, 0], bary[i, 1]
        a = 1.0 - b - c
        u = (a * uv[f, 0, 0] + b * uv[f, 1, 0] + c * uv[f, 2, 0]) / size_m[m, 0]
        v = (a * uv[f, 0, 1] + b * uv[f, 1, 1] + c * uv[f, 2, 1]) / size_m[m, 1]
        first, rows, columns = layout[m, 0], layout[m, 1], layout[m, 2]
        # A point on the far edge of a picture must not wrap to its near edge.
        x = (u - np.floor(u - 1e-6)) * columns - 0.5
        y = (1.0 - (v - np.floor(v - 1e-6))) * rows - 0.5
        x0, y0 = int(np.floor(x)), int(np.floor(y))
        fx, fy = x - x0, y - y0
        xa, xb = x0 % columns, (x0 + 1) % columns
        ya, yb = y0 % rows, (y0 + 1) % rows
        for k in range(3):
            top = pixels[first + ya * columns + xa, k] * (1.0 - fx)
            top += pixels[first + ya * columns + xb, k] * fx
            low = pixels[first + yb * columns + xa, k] * (1.0 - fx)
            low += pixels[first + yb * columns + xb, k] * fx
            out[i, k] = np.uint8(top * (1.0 - fy) + low * fy + 0.5)
    return out
