"""Panel lights under the ceilings, and the light they leave at every place of a scene.

Where a person would hang them: over open floor, a few metres apart. Their light with its shadows is
traced once per scene into a `CubeGrid`; light that floor and walls throw back is added as a smooth
share of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter

from ..kernels.packets import PacketScene
from .cube_grid import AXES, CubeGrid, filled
from .openness import Openness

f32 = np.float32
Array = NDArray[np.float64]

SPACING_M = 2.4
STEP_M = 0.2  # of the search for open floor
EYE_M = 1.2  # above floors: there ceilings are looked for from
LOW_M, HIGH_M = 0.7, 4.0  # a ceiling is this far above the eyes; if none is found,
HUNG_M = 1.5  # a panel hangs this far above them
DROP_M = 0.06  # panels hang so far under the ceiling
CLEAR_M = 0.35  # from what stands as high as the eyes
REACH_M = 7.0
# Brightness: a panel 2.5 m above the floor gives 1 there.
STRENGTH = 2.5**2
SIDEWAYS = 0.25  # share of its light that a panel sends in all directions, not only down
BOUNCE = 0.5  # how much light comes back from surfaces
BOUNCE_M = 1.2
TOP = 8.0  # brightest value kept


def place_panels(scene: PacketScene, vertices: NDArray[np.float32], floors_z_m: Array) -> Array:
    """Centres (P, 3) [m] of panels, one per `SPACING_M` tile of open floor of each storey.

    Args:
        scene: ray structure.
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
        below = _distance(scene, eyes, -1.0, EYE_M + 0.3).reshape(gx.shape)
        above = _distance(scene, eyes, 1.0, HIGH_M).reshape(gx.shape)
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
    """Irradiance of panels (P, 3) [m] on surfaces at each cell, per direction they face.

    A panel is Lambert's disc that shines down: what it gives falls with the cosine at the panel,
    the cosine at the surface and the square of the distance.
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
        seen = ~scene.hidden(np.ascontiguousarray(centers[near]), step)
        toward = step / np.sqrt(square)[:, None]
        down = SIDEWAYS + (1 - SIDEWAYS) * np.maximum(toward[:, 2], 0.0)
        # Fades to nothing where the search for panels ends.
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


def _distance(scene: PacketScene, origins: NDArray[np.float32], up: float, far: float) -> Array:
    """(N,) free way straight up or down [m], at most `far`."""
    directions = np.tile(np.array([0.0, 0.0, up], dtype=f32), (len(origins), 1))
    return scene.trace(origins, directions, np.full(len(origins), far, dtype=f32)).depth.astype(
        np.float64
    )
