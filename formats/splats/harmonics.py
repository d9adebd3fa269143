"""Real spherical harmonics up to degree 3 with the Condon–Shortley phase, as 3DGS uses them."""

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import F32, Array

C0 = 0.28209479177387814
C1 = 0.4886025119029199


def basis(directions: ArrayLike, degree: int) -> Array:
    """Return the harmonics (N, (degree + 1)²) along unit directions (N, 3)."""
    x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
    terms = [np.full_like(x, C0)]
    if degree > 0:
        terms += [-C1 * y, C1 * z, -C1 * x]
    if degree > 1:
        terms += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * z * z - x * x - y * y),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree > 2:
        terms += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
            0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -0.4570457994644658 * x * (4 * z * z - x * x - y * y),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return np.stack(terms, axis=-1)


def rotate_harmonics(harmonics: F32, rotation: Array) -> F32:
    """Return coefficients (N, K, 3) of the same colours after a rotation (3, 3) of the splats.

    Each degree is mixed within itself, by the matrix that reproduces the turned functions along
    well-spread directions.
    """
    degree = round(harmonics.shape[1] ** 0.5) - 1
    if degree == 0:
        return harmonics
    k = np.arange(64) + 0.5
    height, turn = 1 - 2 * k / 64, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=-1)
    new, old = basis(directions, degree), basis(directions @ rotation, degree)
    out = harmonics.copy()
    for band in range(1, degree + 1):
        part = slice(band**2, (band + 1) ** 2)
        mix = np.linalg.lstsq(new[:, part], old[:, part], rcond=None)[0].astype(np.float32)
        out[:, part] = np.einsum("ij,njc->nic", mix, harmonics[:, part])
    return out
