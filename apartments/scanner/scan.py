"""The scanning itself: from the exact apartment to a fused mesh."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ...formats.core.geometry import triangle_normals
from ..config import ScanConfig
from ..home.true_scene import TrueScene
from .depth import DepthCamera, measure, misplaced
from .fusion import DistanceVolume
from .stations import View, views
from .tracing import Tracer

_MARGIN_M = 0.28
_BATCH = 24


def fuse(
    rng: np.random.Generator, scene: TrueScene, tracer: Tracer, config: ScanConfig
) -> DistanceVolume:
    """Take all depth views of `scene` and fuse them."""
    lower, upper = scene.plan.bounds()
    volume = DistanceVolume.empty(
        np.array([*(lower - _MARGIN_M), -0.15]),
        np.array([*(upper + _MARGIN_M), scene.plan.ceiling_m + 0.15]),
        config.voxel_m,
    )
    camera = DepthCamera.of(config)
    normals = triangle_normals(scene.shape.corners).astype(np.float32)
    todo = views(rng, scene.plan, tracer, config)
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
