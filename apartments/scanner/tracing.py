"""Trace rays through the exact apartment."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I32, Array, Floats, Mask
from ...geometry.rays.packets import PacketScene


@dataclass(frozen=True)
class Hits:
    """First hits of rays.

    Attributes:
        face: (N,) int32 triangle, −1 = nothing.
        distance_m: (N,) float32 along the (unit) direction; the rays' reach where nothing was hit.
        bary: (N, 2) float32 weights of the triangle's second and third corner.
    """

    face: I32
    distance_m: F32
    bary: F32


class Tracer:
    """Ray tracer of a triangle soup (F, 3, 3) [m]; several threads may use it at once.

    Attributes:
        scene: its ray structure.
    """

    def __init__(self, corners_m: Array):
        self.scene = PacketScene.of_corners(corners_m)

    def first(
        self, origins_m: Floats, directions: Floats, reach_m: float, coherent: bool = True
    ) -> Hits:
        """Return the first hits of rays (N, 3), (N, 3) within `reach_m`.

        It takes less time if neighbours in the list run close together; `coherent` tells so.
        """
        hits = self.scene.trace(
            origins=origins_m,
            directions=directions,
            far=np.full(len(directions), reach_m, dtype=np.float32),
            coherent=coherent,
        )
        return Hits(hits.prim, hits.depth, np.stack([hits.u, hits.v], axis=1))

    def distance(self, origins_m: Floats, directions: Floats, reach_m: float) -> F32:
        """Return the distance (N,) [m] to the first hit; `reach_m` where there is none."""
        return self.first(origins_m, directions, reach_m).distance_m

    def blocked(self, origins_m: Floats, directions: Floats, reach_m: Floats) -> Mask:
        """Return (N,) whether anything lies within `reach_m` (N,) along each ray."""
        return self.scene.occluded(
            origins=origins_m, directions=directions * np.maximum(reach_m, 0.0)[:, None]
        )
