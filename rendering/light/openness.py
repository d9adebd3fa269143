"""Ambient occlusion of a scene on a grid, so that corners are darker without rays per frame.

Each cell and axis direction of a `CubeGrid` holds the share of the hemisphere that is free nearby.
It is traced once per scene.
"""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, Array, Floats
from ...geometry.rays.packets import PacketScene
from ..kernels.cube_grid import AXES, CubeGrid, cell_centers, filled, inpainted

f32 = np.float32

RAYS = 40
REACH_M = 1.8  # farther surfaces do not darken


@dataclass(frozen=True)
class Openness:
    """Openness of the cells of a scene.

    Attributes:
        grid: openness, 1 = open.
        center_m: (Z, Y, X, 3) float32 centres of the cells, world [m].
        free: (Z, Y, X, 6) openness before it was rounded.
        trust: (Z, Y, X) from 0.02 (inside furniture or walls) to 1 (free).
    """

    grid: CubeGrid
    center_m: F32
    free: Floats
    trust: Floats


def trace_openness(scene: PacketScene, vertices: F32) -> Openness:
    """Trace the cells over the bounds of `vertices` (V, 3) [m], from which `scene` was built."""
    center, grid = cell_centers(vertices)
    origins = center.reshape(-1, 3)
    directions = _sphere_directions(RAYS)
    weights = np.maximum(directions @ AXES.T, 0.0).astype(f32)
    total = np.zeros((len(origins), 6), dtype=f32)
    outside = np.zeros(len(origins), dtype=f32)  # share of rays that see fronts or nothing
    limits = np.full(len(origins), REACH_M, dtype=f32)
    for direction, weight in zip(directions.astype(f32), weights, strict=True):
        hits = scene.trace(
            origins=origins, directions=np.tile(direction, (len(origins), 1)), far=limits
        )
        missed = hits.prim < 0
        total += np.where(missed, f32(1.0), hits.depth / f32(REACH_M))[:, None] * weight
        outside += missed | (hits.normal @ direction < 0)
    cube = (total / weights.sum(0)).reshape(*center.shape[:3], 6)
    trust = np.clip((outside / RAYS - 0.5) * 4.0, 0.02, 1.0).reshape(center.shape[:3])
    free = np.clip(inpainted(cube, trust=trust), 0.0, 1.0)
    return Openness(filled(grid, free, 1.0), center, free, trust)


def _sphere_directions(count: int) -> Array:
    """Return evenly spread unit vectors (count, 3): a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
