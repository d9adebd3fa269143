"""Shoot rays down onto a written floor, on a grid of probes finer than its cells."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...formats.core.arrays import F32, Mask
from ...formats.scene.grid import GridSpec
from ...geometry.rays.packets import PacketScene
from .exported import Surface

PROBE_M = 0.02
# A ray starts this far above the floor and must hit by this far below it.
START_M, TOLERANCE_M = 0.15, 0.03
# Rays at once, and on a level in all: beyond that the probes get coarser.
CHUNK, MAX_PROBES = 500_000, 8_000_000
# A ray exactly along a shared edge may slip between both faces; a shifted one must not.
_SHIFTS_M = ((0.0, 0.0), (1e-3, 7e-4), (-8e-4, 6e-4))


@dataclass(frozen=True)
class Probes:
    """Results of rays down onto a level, one through each cell of `grid` (rows, columns).

    `per_side` of them lie along a floor's cell. `height_m` is where they hit, NaN where they fall
    past the floor, `added` whether they hit what the repair added.
    """

    grid: GridSpec
    per_side: int
    height_m: F32
    added: Mask

    @property
    def fell(self) -> Mask:
        """Return the rays that hit nothing, or only something below the floor."""
        return np.isnan(self.height_m)

    def spread[T: np.generic](self, cells: NDArray[T]) -> NDArray[T]:
        """Upsample a map over the floor's cells to the probes."""
        return np.repeat(np.repeat(cells, self.per_side, axis=0), self.per_side, axis=1)


def shoot_down(surface: Surface, grid: GridSpec, expected_m: F32) -> Probes:
    """Shoot rays every 2 cm over all cells of a floor, expected at heights (rows, columns)."""
    per_side = int(np.ceil(grid.cell_m / PROBE_M - 1e-9))
    while per_side > 1 and expected_m.size * per_side**2 > MAX_PROBES:
        per_side -= 1
    probes = GridSpec(
        grid.origin_xy_m, grid.cell_m / per_side, grid.rows * per_side, grid.columns * per_side
    )
    height = np.full(probes.shape, np.nan, dtype=np.float32)
    added = np.zeros(probes.shape, dtype=bool)
    if len(surface.triangles_m):
        scene = PacketScene.of_corners(surface.triangles_m)
        rows = max(CHUNK // probes.columns, 1)
        for start in range(0, probes.rows, rows):
            part = slice(start, min(start + rows, probes.rows))
            _shoot(scene, surface, probes, part, expected_m=expected_m, height=height, added=added)
    return Probes(probes, per_side, height, added)


def _shoot(
    scene: PacketScene,
    surface: Surface,
    probes: GridSpec,
    part: slice,
    *,
    expected_m: F32,
    height: F32,
    added: Mask,
) -> None:
    """Fill the rows `part` of `height` and `added`."""
    i, j = np.mgrid[part, 0 : probes.columns].reshape(2, -1)
    per_side = probes.rows // expected_m.shape[0]
    expected = expected_m[i // per_side, j // per_side].astype(np.float64)
    xy = probes.center_of(np.stack([i, j], axis=1))
    left = np.arange(len(xy))
    for shift in _SHIFTS_M:
        z = expected[left] + START_M
        origin = np.column_stack([xy[left] + shift, z]).astype(np.float32)
        hit = scene.trace(
            origins=origin,
            directions=np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(left), 1)),
            far=np.full(len(left), np.inf, dtype=np.float32),
        )
        at = z - hit.depth.astype(np.float64)
        good = (hit.prim >= 0) & (at >= expected[left] - TOLERANCE_M)
        selected = left[good]
        height[i[selected], j[selected]] = at[good]
        added[i[selected], j[selected]] = surface.added[hit.prim[good]]
        left = left[~good]
        if not len(left):
            return
