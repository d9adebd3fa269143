"""Flatten bumps, spikes and dents of a scanned floor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..grid.columns import Columns
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
    mesh: WorldMesh,
    columns: Columns,
    evidence: Evidence,
    height_m: NDArray[np.float64],
    config: RepairConfig,
) -> tuple[WorldMesh, list[Bump]]:
    """Move the vertices of small bumps and dents onto the reference height.

    A feature is small if it deviates by at most `bump_height_m`, is narrower than `bump_width_m`
    both ways and nothing stands on it.

    Args:
        columns: the scan's vertical samples over the fine grid.
        height_m: (rows, columns) reference floor height everywhere.
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
    return mesh.moved(_pressed(mesh, press, evidence, height_m, grid, config)), bumps


def _pressed(
    mesh: WorldMesh,
    press: NDArray[np.bool_],
    evidence: Evidence,
    height_m: NDArray[np.float64],
    grid: GridSpec,
    config: RepairConfig,
) -> NDArray[np.float64]:
    """Return vertex positions, those over flattened cells moved to the reference height."""
    cell = grid.cell_of(mesh.vertices[:, :2])
    inside = grid.inside(cell)
    chosen = np.zeros(len(mesh.vertices), dtype=bool)
    chosen[inside] = press[tuple(cell[inside].T)]
    index = np.flatnonzero(chosen)
    position = (mesh.vertices[index, :2] - np.asarray(grid.origin_xy_m)) / grid.cell_m - 0.5
    target = ndimage.map_coordinates(height_m, position[:, ::-1].T, order=1, mode="nearest")
    near = np.abs(mesh.vertices[index, 2] - target) <= config.bump_height_m + 0.01
    vertices = mesh.vertices.copy()
    vertices[index[near], 2] = target[near]
    return vertices
