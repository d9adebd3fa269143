"""Storeys: which of the horizontal surfaces are floors, and which floors belong together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..formats.errors import SceneError
from ..formats.grid import GridSpec
from .columns import Columns
from .config import RepairConfig
from .maps import grow
from .surfaces import Surfaces

# A person stands where this much is free above.
STANDING_M = 1.6
# Floors of one storey differ by less than this; storeys by more.
STOREY_M = 1.5
# A surface this far above a floor that surrounds it is furniture, unless it is large.
FURNITURE_M = (0.15, 1.4)
PLATFORM_M2 = 8.0


@dataclass(frozen=True)
class ScannedFloor:
    """The floor of one storey as it was scanned.

    Attributes:
        grid: fine cells.
        z_m: (rows, columns) float64 world height, NaN where no floor was scanned.
        face: (rows, columns) int32 face hit, −1 where none.
        floor_z_m: median height.
    """

    grid: GridSpec
    z_m: NDArray[np.float64]
    face: NDArray[np.int32]
    floor_z_m: float


def find_levels(
    surfaces: Surfaces, columns: Columns, normal_z: NDArray[np.float64], config: RepairConfig
) -> list[ScannedFloor]:
    """Floors of all storeys, lowest first.

    Raises:
        SceneError: nothing here can be stood on.
    """
    grid = columns.grid
    cell_m2 = grid.cell_m**2
    size = np.bincount(surfaces.part, minlength=surfaces.parts) * cell_m2
    standing = np.bincount(
        surfaces.part, weights=surfaces.clear_m >= STANDING_M, minlength=surfaces.parts
    )
    standing = standing * cell_m2
    median = ndimage.median(surfaces.z_m, surfaces.part, np.arange(surfaces.parts))
    walls_above, walls_below = _walls_around(surfaces, columns, normal_z)
    candidates = [
        p
        for p in np.argsort(-standing)
        if standing[p] >= config.min_floor_m2 and walls_above[p] >= 0.5 * walls_below[p]
    ]
    storeys: list[list[int]] = []
    for p in sorted(candidates, key=lambda p: -standing[p]):
        if _is_furniture(p, surfaces, median, size, grid):
            continue
        for storey in storeys:
            if abs(median[storey[0]] - median[p]) < STOREY_M:
                storey.append(p)
                break
        else:
            storeys.append([p])
    if not storeys:
        largest = float(standing.max()) if surfaces.parts else 0.0
        raise SceneError(
            f"no floor found: the largest level surface with {STANDING_M} m of free height "
            f"measures {largest:.2f} m²; valid: at least {config.min_floor_m2} m² (set --up or "
            "--unit if the scan is turned or scaled wrongly)"
        )
    floors = [_floor_of(storey, surfaces, median, size, grid) for storey in storeys]
    return sorted(floors, key=lambda floor: floor.floor_z_m)


def _walls_around(
    surfaces: Surfaces, columns: Columns, normal_z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Samples of anything within 0.2 … 2 m above and below each surface, per surface sample.

    A floor has a room above it, a ceiling or a roof has it below.
    """
    del normal_z
    cells = len(columns.start) - 1
    cell, z = columns.cell, columns.z
    rows, columns_ = columns.grid.shape
    above = np.zeros(surfaces.parts)
    below = np.zeros(surfaces.parts)
    count = np.bincount(surfaces.part, minlength=surfaces.parts)
    reach = max(1, round(0.3 / columns.grid.cell_m))
    for p in np.flatnonzero(count * columns.grid.cell_m**2 >= 0.5):
        mine = surfaces.part == p
        mask = np.zeros(cells, dtype=bool)
        mask[surfaces.cell[mine]] = True
        near = grow(mask.reshape(rows, columns_), reach).ravel()
        height = z[near[cell]] - np.median(surfaces.z_m[mine])
        above[p] = np.count_nonzero((height > 0.2) & (height < 2.0))
        below[p] = np.count_nonzero((height < -0.2) & (height > -2.0))
    return above, below


def _is_furniture(
    p: int,
    surfaces: Surfaces,
    median: NDArray[np.float64],
    size: NDArray[np.float64],
    grid: GridSpec,
) -> bool:
    """A surface that stands over a larger one lying around it, at the height of furniture."""
    if size[p] >= PLATFORM_M2:
        return False
    rise = median[p] - median
    lower = (rise > FURNITURE_M[0]) & (rise < FURNITURE_M[1]) & (size > size[p])
    if not lower.any():
        return False
    mask = np.zeros(grid.rows * grid.columns, dtype=bool)
    mask[surfaces.cell[surfaces.part == p]] = True
    reach = max(1, round(0.4 / grid.cell_m))
    near = grow(mask.reshape(grid.shape), reach).ravel()
    around = near[surfaces.cell] & lower[surfaces.part]
    return bool(around.any())


def _floor_of(
    storey: list[int],
    surfaces: Surfaces,
    median: NDArray[np.float64],
    size: NDArray[np.float64],
    grid: GridSpec,
) -> ScannedFloor:
    """All surfaces at the storey's heights that are not above another of its floors."""
    main = median[storey[0]]
    chosen = np.zeros(surfaces.parts, dtype=bool)
    chosen[storey] = True
    # Small pieces at floor height: floor seen between furniture, or cut off by it.
    lowest = min(median[p] for p in storey)
    highest = max(median[p] for p in storey)
    chosen |= (median > lowest - 0.1) & (median < highest + 0.1) & (size >= 4 * grid.cell_m**2)
    mine = chosen[surfaces.part]
    z = np.full(grid.rows * grid.columns, np.nan)
    face = np.full(len(z), -1, dtype=np.int32)
    # Where several lie in one cell the lowest at walking height is the floor.
    order = np.argsort(-surfaces.z_m[mine], kind="stable")
    cell = surfaces.cell[mine][order]
    z[cell] = surfaces.z_m[mine][order]
    face[cell] = surfaces.face[mine][order]
    del main
    shape = grid.shape
    return ScannedFloor(grid, z.reshape(shape), face.reshape(shape), float(np.nanmedian(z)))
