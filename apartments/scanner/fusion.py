"""Scan the exact apartment: fuse depth views into a truncated signed distance volume."""

import numpy as np

from ...formats.core.arrays import F32
from ...formats.core.geometry import triangle_normals
from ...formats.process.threads import in_order
from ...geometry.fusion.volume import DistanceVolume
from ..building.true_scene import TrueScene
from ..config import ScanConfig
from .depth import DepthCamera, measure, misplaced
from .stations import View, views
from .tracing import Tracer

_MARGIN_M = 0.28


def fuse(
    rng: np.random.Generator, scene: TrueScene, tracer: Tracer, config: ScanConfig
) -> DistanceVolume:
    """Take all depth views of `scene` and fuse them."""
    lower, upper = scene.bounds()
    margin = np.array([_MARGIN_M, _MARGIN_M, 0.15])
    volume = DistanceVolume.empty(lower - margin, upper + margin, config.voxel_m)
    camera = DepthCamera.of(config)
    normals = triangle_normals(scene.shape.corners).astype(np.float32)
    true_views = [v for plan in scene.storeys for v in views(rng, plan, tracer, config)]

    def scan(task: tuple[View, np.random.Generator]) -> tuple[F32, View]:
        view, stream = task
        depth = measure(stream, tracer, normals, camera, view, config)
        return depth, misplaced(stream, view, config)

    tasks = zip(true_views, rng.spawn(len(true_views)), strict=True)
    for depth, at in in_order(scan, tasks, busy=True):
        volume.integrate(
            depth, focal_px=camera.focal_px, position_m=at.position_m, rotation=at.rotation
        )
    return volume
