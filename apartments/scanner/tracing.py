"""Trace rays through the exact building."""

import numpy as np

from ...formats.core.arrays import F32, Array, Floats, Mask
from ...geometry.rays.packets import PacketHits, PacketScene


class Tracer(PacketScene):
    """Ray tracer of loose triangles (F, 3, 3) [m]; several threads may use it at once."""

    def __init__(self, corners_m: Array):
        super().__init__(corners_m.reshape(-1, 3), np.arange(3 * len(corners_m)).reshape(-1, 3))

    def first(
        self, origins_m: Floats, directions: Floats, reach_m: float, coherent: bool = True
    ) -> PacketHits:
        """Return the first hits of rays (N, 3), (N, 3) of unit length within `reach_m`.

        It takes less time if neighbours in the list run close together; `coherent` tells so.
        """
        far = np.full(len(directions), reach_m, dtype=np.float32)
        return self.trace(origins=origins_m, directions=directions, far=far, coherent=coherent)

    def distance(self, origins_m: Floats, directions: Floats, reach_m: float) -> F32:
        """Return the distance (N,) [m] to the first hit; `reach_m` where there is none."""
        return self.first(origins_m, directions, reach_m).depth

    def blocked(self, origins_m: Floats, directions: Floats, reach_m: Floats) -> Mask:
        """Return (N,) whether anything lies within `reach_m` (N,) along each ray."""
        reach = np.maximum(reach_m, 0.0)[:, None]
        return self.occluded(origins=origins_m, directions=directions * reach)
