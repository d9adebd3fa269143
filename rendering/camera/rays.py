"""Rays of pixels. Directions have length 1 along the optical axis, so that t is planar depth."""

import numpy as np

from ...formats.core.arrays import F32, I32, Array
from ...formats.process.kernel import kernel

# Samples around the centre, whose ray is traced anyway. Of 7,000 such triples the one whose mean
# comes closest to what straight edges cover, half of them upright or level, half at any angle.
SUBPIXELS = np.array([[0.385, 0.134], [-0.116, -0.384], [-0.339, 0.33]], dtype=np.float32)


@kernel(3)
def fill_directions(
    rotation: Array,
    focal_px: float,
    width: int,
    height: int,
    out: F32,
) -> None:
    """Write the world directions of all pixel centres, row by row.

    Args:
        rotation: (3, 3) optical axes (columns x right, y down, z forward) in the world.
        focal_px: focal length [px].
        width: image width [px].
        height: image height [px].
        out: (height · width, 3), written.
    """
    k = 0
    for row in range(height):
        y = (row + 0.5 - 0.5 * height) / focal_px
        for column in range(width):
            x = (column + 0.5 - 0.5 * width) / focal_px
            for axis in range(3):
                out[k, axis] = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2]
            k += 1


@kernel(3)
def subpixel_directions(
    pixels: I32,
    subpixels: F32,
    rotation: Array,
    focal_px: float,
    width: int,
    height: int,
) -> F32:
    """Return the world directions (K · S, 3) of S samples in each of K pixels.

    Args:
        pixels: (K,) row-major pixel indices.
        subpixels: (S, 2) offsets from the centre [px].
        rotation: (3, 3) optical axes in the world.
        focal_px: focal length [px].
        width: image width [px].
        height: image height [px].
    """
    samples = subpixels.shape[0]
    out = np.empty((pixels.shape[0] * samples, 3), dtype=np.float32)
    for i in range(pixels.shape[0]):
        row = pixels[i] // width
        column = pixels[i] - row * width
        for s in range(samples):
            x = (column + 0.5 + subpixels[s, 0] - 0.5 * width) / focal_px
            y = (row + 0.5 + subpixels[s, 1] - 0.5 * height) / focal_px
            for axis in range(3):
                out[i * samples + s, axis] = (
                    rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2]
                )
    return out


def list_order(count: int, *, lanes: int) -> I32:
    """Return rays 0 … count − 1 in order, padded to whole packets of `lanes` rays with −1."""
    order = np.full(-(-count // lanes) * lanes, -1, dtype=np.int32)
    order[:count] = np.arange(count)
    return order
