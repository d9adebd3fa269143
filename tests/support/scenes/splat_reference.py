"""A plain implementation of 3D Gaussian splatting's published formula, pixel by pixel.

Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering" (2023): every Gaussian
at every pixel in float64, sorted as a whole, with no tiles and no culling but what the formula has.
"""

import numpy as np
from numpy.typing import NDArray

from vlnpe.formats.core.frames import quat_to_matrix
from vlnpe.formats.splats.harmonics import basis
from vlnpe.formats.splats.record import GaussianCloud
from vlnpe.geometry.splatting.draw import NEAR_M, Eye

Array = NDArray[np.float64]


def reference_image(
    cloud: GaussianCloud, eye: Eye, *, antialiased: bool = False, blur: float = 0.3
) -> tuple[Array, Array]:
    """Return colour (H, W, 3) over black, and the light that gets through (H, W)."""
    camera = eye.camera
    width, height, focal = camera.width_px, camera.height_px, camera.focal_px
    view = eye.rotation_world.T
    away = cloud.position.astype(np.float64) - eye.position_world_m
    at = away @ view.T
    axes = quat_to_matrix(cloud.quat_wxyz) * cloud.scale[:, None, :]
    full = axes @ np.swapaxes(axes, 1, 2)
    direction = away / np.linalg.norm(away, axis=1, keepdims=True)
    rgb = np.einsum("nk,nkc->nc", basis(direction, cloud.degree), cloud.harmonics) + 0.5
    rgb = np.maximum(rgb, 0)
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    color, light = np.zeros((height, width, 3)), np.ones((height, width))
    done = np.zeros((height, width), dtype=bool)
    for g in np.argsort(at[:, 2], kind="stable"):
        x, y, z = at[g]
        if z < NEAR_M:
            continue
        slope_x = np.clip(x / z, *(1.3 * 0.5 * width / focal * np.array([-1, 1])))
        slope_y = np.clip(y / z, *(1.3 * 0.5 * height / focal * np.array([-1, 1])))
        jacobian = focal / z * np.array([[1, 0, -slope_x], [0, 1, -slope_y]])
        flat = jacobian @ view @ full[g] @ view.T @ jacobian.T
        wide = flat + blur * np.eye(2)
        opacity = float(cloud.opacity[g])
        if antialiased:
            opacity *= np.sqrt(max(np.linalg.det(flat) / np.linalg.det(wide), 0.000025))
        conic = np.linalg.inv(wide)
        dx = u - (focal * x / z + 0.5 * (width - 1))
        dy = v - (focal * y / z + 0.5 * (height - 1))
        power = conic[0, 0] * dx * dx + 2 * conic[0, 1] * dx * dy + conic[1, 1] * dy * dy
        alpha = np.minimum(opacity * np.exp(-0.5 * power), 0.99)
        drawn = (alpha >= 1 / 255) & ~done
        after = light * (1 - alpha)
        done |= drawn & (after < 1e-4)
        drawn &= ~done
        color[drawn] += (alpha * light)[drawn, None] * rgb[g]
        light[drawn] = after[drawn]
    return color, light


def psnr_db(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the peak signal-to-noise ratio [dB] of images in 0–1."""
    error = np.mean((np.clip(image, 0, 1) - np.clip(other, 0, 1)) ** 2)
    return float(-10 * np.log10(max(error, 1e-20)))
