"""Simulate depth images of the exact apartment with a depth camera's errors."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, I32
from ...geometry.rays.library import lanes
from ...geometry.rays.packets import TILES, tile_order
from ..config import ScanConfig
from .stations import View
from .tracing import Tracer

RANGE_M = (0.25, 5.0)
# Below this cosine between ray and surface normal nothing returns; up to the second, some does.
_GRAZING = (0.1, 0.32)


@dataclass(frozen=True)
class DepthCamera:
    """A pinhole depth camera.

    Attributes:
        directions: (H · W, 3) float32 unit rays in the camera frame.
        cosine: (H · W,) float32 cosine of each ray with the optical axis.
        traced: (H · W,) pixels in the order in which their rays are traced, tile by tile.
        back: (H · W,) place of each pixel in that order.
    """

    width_px: int
    height_px: int
    focal_px: float
    directions: F32
    cosine: F32
    traced: I32
    back: NDArray[np.intp]

    @staticmethod
    def of(config: ScanConfig) -> "DepthCamera":
        """Return the scanner's camera."""
        width, height = config.view_px
        focal = 0.5 * width / float(np.tan(0.5 * np.deg2rad(config.view_hfov_deg)))
        u, v = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        rays = np.stack([u, v, np.full_like(u, focal)], -1).reshape(-1, 3)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        rays = rays.astype(np.float32)
        tiles = tile_order(config.view_px, tile_px=TILES[lanes()])
        traced = tiles[tiles >= 0]
        cosine, back = rays[:, 2].copy(), np.argsort(traced)
        return DepthCamera(width, height, focal, rays, cosine, traced, back)


def measure(
    rng: np.random.Generator,
    tracer: Tracer,
    normals: F32,
    camera: DepthCamera,
    view: View,
    config: ScanConfig,
) -> F32:
    """Return a noisy depth image (H, W) [m] along the optical axis; 0 where nothing returned.

    The axial noise grows with the square of the distance, as measured for structured-light
    cameras (Khoshelham and Elberink, 2012); a slowly varying error over the image and dropouts at
    grazing angles are added. `normals` are the (F, 3) unit normals of the traced triangles.
    """
    directions = camera.directions @ view.rotation.T.astype(np.float32)
    origins = np.broadcast_to(view.position_m.astype(np.float32), directions.shape)
    hits = tracer.first(origins, directions.take(camera.traced, axis=0), RANGE_M[1] * 1.6)
    face = hits.prim.take(camera.back)
    depth = hits.depth.take(camera.back) * camera.cosine
    facing = np.abs(np.einsum("ij,ij->i", normals.take(face, axis=0), directions))
    lost = facing < _GRAZING[0] + (_GRAZING[1] - _GRAZING[0]) * rng.random(len(facing)) ** 3
    coarse, size = (
        rng.standard_normal((5, 7), dtype=np.float32),
        (camera.width_px, camera.height_px),
    )
    bias = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC).ravel()
    sigma = config.noise_m + config.noise_per_m2 * depth**2
    noisy = depth + sigma * (rng.standard_normal(len(depth), dtype=np.float32) + 0.9 * bias)
    # Said by what is good, so that a reading which is not a number counts as none.
    good = (face >= 0) & ~lost & (depth >= RANGE_M[0]) & (depth <= RANGE_M[1])
    image = np.where(good & np.isfinite(noisy), noisy, 0.0).astype(np.float32)
    return image.reshape(camera.height_px, camera.width_px)


def misplaced(rng: np.random.Generator, view: View, config: ScanConfig) -> View:
    """Return `view` with a small error of position and attitude, as the scanner estimates it."""
    x, y, z = rng.normal(0, np.deg2rad(config.pose_noise_deg), 3)
    turn = np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    u, _, vt = np.linalg.svd(turn)
    return View(view.position_m + rng.normal(0, config.pose_noise_m, 3), u @ vt @ view.rotation)
