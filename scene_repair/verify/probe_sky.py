"""Shoot rays up from the walkable floor: where they meet nothing, no camera measures depth."""

import numpy as np

from ...formats.scene.bundle import VisualMesh
from ...formats.scene.freemap import Freemap
from ...geometry.rays.packets import PacketScene
from ..storeys.surfaces import STANDING_M

# Rays of a level, from cells spread evenly over what is walkable.
MAX_RAYS = 10_000


def open_sky_share(visual: VisualMesh, freemap: Freemap) -> float:
    """Return the share of a level's walkable floor over whose free height there is nothing."""
    cells = np.argwhere(freemap.traversable)
    if not len(cells):
        return 0.0
    count = min(len(cells), MAX_RAYS)
    cells = cells[np.linspace(0, len(cells) - 1, count).round().astype(int)]
    height = freemap.floor_z_m[tuple(cells.T)] + STANDING_M
    hit = PacketScene.of_corners(visual.vertices[visual.faces]).trace(
        origins=np.column_stack([freemap.grid.center_of(cells), height]).astype(np.float32),
        directions=np.tile(np.array([0.0, 0.0, 1.0], dtype=np.float32), (count, 1)),
        far=np.full(count, np.inf, dtype=np.float32),
    )
    return float((hit.prim < 0).mean())
