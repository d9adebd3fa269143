"""The scanning itself: from the exact apartment to a fused mesh."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..config import ScanConfig
from ..home.true_scene import TrueScene
from .depth import DepthCamera, measure, misplaced
from .fusion import DistanceVolume
from .stations import View, views
from .tracing import Tracer

_MARGIN_M = 0.28
_BATCH = 24


def unit_normals(corners_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """(F, 3) unit normals of a triangle soup (F, 3, 3)."""
    cross = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return (cross / np.maximum(length, 1e-12)).astype(np.float32)


def fuse(
    rng: np.random.Generator, scene: TrueScene, tracer: Tracer, config: ScanConfig
) -> DistanceVolume:
    """Take all depth views of `scene` and fuse them."""
    lower, upper = scene.bounds()
    margin = np.array([_MARGIN_M, _MARGIN_M, 0.15])
    volume = DistanceVolume.empty(lower - margin, upper + margin, config.voxel_m)
    camera = DepthCamera.of(config)
    normals = unit_normals(scene.shape.corners)
    todo = [v for plan in scene.storeys for v in views(rng, plan, tracer, config)]
    # Every view has its own stream, so that the order in which threads finish does not matter.
    streams = rng.spawn(len(todo))

    def shoot(job: tuple[View, np.random.Generator]) -> tuple[View, NDArray[np.float32]]:
        view, stream = job
        depth = measure(stream, tracer, normals, camera, view, config)
        return misplaced(stream, view, config), depth

    with ThreadPoolExecutor(1) as pool:
        for first in range(0, len(todo), _BATCH):
            jobs = zip(todo[first : first + _BATCH], streams[first : first + _BATCH], strict=True)
            for believed, depth in list(pool.map(shoot, jobs)):
                volume.integrate(pool, camera, believed, depth)
    return volume
