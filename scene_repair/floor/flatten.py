"""Flatten bumps, spikes and dents of a scanned floor."""

from dataclasses import dataclass, replace

import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..grid.columns import Columns
from ..grid.height_field import heights_at
from ..grid.morphology import grow, grown_window, label, windows
from ..grid.world_mesh import WorldMesh
from .evidence import Evidence

# Something rising this far over a bump shows that the bump is the foot of a thing.
FOOT_M = 0.5


@dataclass(frozen=True)
class Bump:
    """One flattened feature: where, how high (dents negative), how wide."""

    center_xy_m: tuple[float, float]
    height_m: float
    width_m: float


def flatten_bumps(
    mesh: WorldMesh, columns: Columns, evidence: Evidence, height_m: Array, config: RepairConfig
) -> tuple[WorldMesh, list[Bump]]:
    """Move the vertices of small bumps and dents onto the reference height (rows, columns).

    A feature is small if it deviates by at most `bump_height_m`, is narrower than `bump_width_m`
    both ways and nothing stands on it.
    """
    grid = columns.grid
    deviation = np.where(evidence.covered, evidence.z_m - height_m, 0.0)
    parts, _ = label(np.abs(deviation) > config.bump_tolerance_m, diagonal=True)
    above = columns.z - height_m.ravel()[columns.cell]
    carries = np.zeros(grid.rows * grid.columns, dtype=bool)
    carries[columns.cell[(above > config.bump_height_m) & (above < FOOT_M)]] = True
    carries = carries.reshape(grid.shape) | evidence.wall
    press = np.zeros(grid.shape, dtype=bool)
    bumps = []
    for k, window in enumerate(windows(parts), start=1):
        mask = parts[window] == k
        width = max(mask.shape) * grid.cell_m
        peak = deviation[window][mask]
        peak = float(peak[np.argmax(np.abs(peak))])
        if width > config.bump_width_m or abs(peak) > config.bump_height_m:
            continue
        wide = grown_window(window, 2, grid.shape)
        if carries[wide].any():
            continue
        press[window] |= mask
        corner = np.array([window[0].start, window[1].start])
        x, y = (float(v) for v in grid.center_of(np.argwhere(mask).mean(axis=0) + corner))
        bumps.append(Bump((x, y), peak, width))
    if not bumps:
        return mesh, []
    # One cell more, so that the foot of a bump between cell centres comes along.
    press = grow(press)
    return _pressed(mesh, press, height_m, grid, config), bumps


def _pressed(
    mesh: WorldMesh, press: Mask, height_m: Array, grid: GridSpec, config: RepairConfig
) -> WorldMesh:
    """Return the mesh with vertices over flattened cells moved to the reference height."""
    cell = grid.cell_of(mesh.vertices[:, :2])
    inside = grid.inside(cell)
    flat = np.zeros(len(mesh.vertices), dtype=bool)
    flat[inside] = press[tuple(cell[inside].T)]
    index = np.flatnonzero(flat)
    target = heights_at(height_m, grid, mesh.vertices[index, :2])
    near = np.abs(mesh.vertices[index, 2] - target) <= config.bump_height_m + 0.01
    vertices = mesh.vertices.copy()
    vertices[index[near], 2] = target[near]
    return replace(mesh, vertices=vertices)
