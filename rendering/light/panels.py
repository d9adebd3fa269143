"""Panel lights under the ceilings, and their irradiance everywhere in a scene.

Panels hang over open floor, a few metres apart. Their light with its shadows is traced once per
scene into a `CubeGrid`; light reflected by floor and walls is added as a smooth share of it.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from ...formats.core.arrays import F32, Array
from ...geometry.rays.packets import PacketScene
from ..kernels.cube_grid import AXES, CubeGrid, filled
from .openness import Openness

f32 = np.float32
SPACING_M = 2.4
STEP_M = 0.2  # of the search for open floor
EYE_M = 1.2  # height above the floor from which ceilings are searched
LOW_M, HIGH_M = 0.7, 4.0  # range of a ceiling's height above that
HUNG_M = 1.5  # height of a panel above that where no ceiling is found
DROP_M = 0.06  # distance of a panel from the ceiling
CLEAR_M = 0.35  # distance of a panel from objects at that height
REACH_M = 7.0
# A panel 2.5 m above the floor gives irradiance 1 there.
STRENGTH = 2.5**2
SIDEWAYS = 0.25  # share of a panel's light that goes in all directions, not only down
BOUNCE = 0.5  # share of light that surfaces reflect
BOUNCE_M = 1.2
TOP = 8.0  # largest value stored


def place_panels(scene: PacketScene, vertices: F32, floors_z_m: Array) -> Array:
    """Return the centres (P, 3) [m] of panels, one per `SPACING_M` tile of open floor.

    Args:
        vertices: (V, 3) of the mesh [m].
        floors_z_m: (L,) heights of the storeys' floors.
    """
    lower, upper = vertices[:, :2].min(0), vertices[:, :2].max(0)
    counts = np.maximum(np.ceil((upper - lower) / STEP_M).astype(int), 1)
    x, y = (lower[k] + STEP_M * (np.arange(counts[k]) + 0.5) for k in range(2))
    gy, gx = np.meshgrid(y, x, indexing="ij")
    tile = (gy - lower[1]) // SPACING_M * 10_000 + (gx - lower[0]) // SPACING_M
    panels = []
    for floor_z in floors_z_m:
        eyes = np.stack([gx, gy, np.full_like(gx, floor_z + EYE_M)], -1).reshape(-1, 3).astype(f32)
        below = _distance(scene, eyes, up=-1.0, reach_m=EYE_M + 0.3).reshape(gx.shape)
        above = _distance(scene, eyes, up=1.0, reach_m=HIGH_M).reshape(gx.shape)
        inside = (below < EYE_M + 0.3) & (above > LOW_M)
        padded = np.asarray(distance_transform_edt(np.pad(inside, 1)))
        clear = padded[1:-1, 1:-1] * STEP_M
        height = np.where(above < HIGH_M, above - DROP_M, HUNG_M)
        for number in np.unique(tile[clear > CLEAR_M]):
            best = np.argmax(np.where(tile == number, clear, 0.0))
            at = np.unravel_index(best, gx.shape)
            panels.append([gx[at], gy[at], floor_z + EYE_M + height[at]])
    return np.array(panels, dtype=np.float64).reshape(-1, 3)


def trace_panels(scene: PacketScene, openness: Openness, panels_m: Array) -> CubeGrid:
    """Return the irradiance of panels (P, 3) [m] at each cell, per direction that a surface faces.

    A panel is a Lambertian disc that shines down: its irradiance falls with the cosine at the
    panel, the cosine at the surface and the square of the distance.
    """
    centers = openness.center_m.reshape(-1, 3)
    direct = np.zeros((len(centers), 6), dtype=f32)
    for panel in panels_m.astype(f32):
        step = panel - centers
        square = np.einsum("ni,ni->n", step, step)
        near = np.flatnonzero(square < REACH_M**2)
        if not len(near):
            continue
        step, square = step[near], np.maximum(square[near], f32(0.15))
        seen = ~scene.occluded(origins=np.ascontiguousarray(centers[near]), directions=step)
        toward = step / np.sqrt(square)[:, None]
        down = SIDEWAYS + (1 - SIDEWAYS) * np.maximum(toward[:, 2], 0.0)
        # Fades to zero at the largest distance considered.
        fade = (1.0 - square / REACH_M**2) ** 2
        strength = np.where(seen, STRENGTH * down * fade / square, 0.0).astype(f32)
        direct[near] += strength[:, None] * np.maximum(toward @ AXES.T.astype(f32), 0.0)
    shape = openness.free.shape
    direct = direct.reshape(shape) * openness.trust[..., None]
    weight = openness.trust
    cell = 1.0 / float(openness.grid.per_m)
    spread = gaussian_filter(weight, BOUNCE_M / cell, mode="nearest")
    returned = gaussian_filter(direct.mean(-1) * weight, BOUNCE_M / cell, mode="nearest") / spread
    around = np.stack([gaussian_filter(direct[..., k], 0.7, mode="nearest") for k in range(6)], -1)
    around /= gaussian_filter(weight, 0.7, mode="nearest")[..., None]
    light = around + BOUNCE * returned[..., None] * (0.3 + 0.7 * openness.free)
    return filled(openness.grid, light, TOP)


def _distance(scene: PacketScene, origins: F32, *, up: float, reach_m: float) -> Array:
    """Return the free distance (N,) straight up (1) or down (−1) [m], at most `reach_m`."""
    directions = np.tile(np.array([0.0, 0.0, up], dtype=f32), (len(origins), 1))
    far = np.full(len(origins), reach_m, dtype=f32)
    hits = scene.trace(origins=origins, directions=directions, far=far)
    return hits.depth.astype(np.float64)
