"""Find storeys: which horizontal surfaces are floors, and which floors belong together."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...formats.core.errors import SceneError
from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..grid.columns import Columns
from ..grid.morphology import grow
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from .reference import without_pits
from .surfaces import STANDING_M, Surfaces

# Floors of one storey differ by less than this; storeys by more.
STOREY_M = 1.5
# A surface this far above a floor that surrounds it is furniture, unless it is large.
FURNITURE_M = (0.15, 1.4)
PLATFORM_M2 = 8.0
# What lies this far around a surface decides whether a room is over or under it.
AROUND_M = 0.3
WALLS_ABOVE_SHARE = 0.5
RISES_M = np.array([0.5, 1.0, 1.5])
# Faces steeper than this are upright: a pitched roof must not pass for the walls over itself.
UPRIGHT_NORMAL_Z = 0.8
# A surface that rises by more than this over a length, in most of its places, is a roof; the
# steepest ramps that people build rise by half as much.
PITCH, PITCH_OVER_M = 0.2, 0.25
# The winding of faces is trusted if this share of the floor agrees.
ALIKE_SHARE = 0.7
# Exporters that put a ceiling in the plane of the floor above are that exact.
COPLANAR_M = 0.006
# Pieces of floor too small to be judged by themselves lie this near to a floor's height.
PIECE_M = 0.1


@dataclass(frozen=True)
class ScannedFloor:
    """The floor of one storey as it was scanned.

    Attributes:
        grid: fine cells.
        z_m: (rows, columns) float64 world height, NaN where no floor was scanned.
        floor_z_m: median height.
    """

    grid: GridSpec
    z_m: NDArray[np.float64]
    floor_z_m: float


def find_levels(
    surfaces: Surfaces, columns: Columns, mesh: WorldMesh, config: RepairConfig
) -> list[ScannedFloor]:
    """Return the floors of all storeys, lowest first.

    Raises:
        SceneError: nothing here can be stood on.
    """
    parts = _measure(surfaces, columns, mesh, config.min_floor_m2)
    floors = [
        p
        for p in np.argsort(-parts.standing_m2)
        if parts.standing_m2[p] >= config.min_floor_m2
        and parts.pitch[p] <= PITCH
        and parts.above[p] >= parts.below[p] * WALLS_ABOVE_SHARE
        and not _is_furniture(int(p), surfaces, parts, columns.grid)
    ]
    storeys: list[list[int]] = []
    for p in floors:
        for storey in storeys:
            if abs(parts.height_m[storey[0]] - parts.height_m[p]) < STOREY_M:
                storey.append(int(p))
                break
        else:
            storeys.append([int(p)])
    if not storeys:
        largest = float(parts.standing_m2.max()) if surfaces.parts else 0.0
        raise SceneError(
            f"no floor found: the largest level surface with {STANDING_M} m of free height "
            f"measures {largest:.2f} m²; valid: at least {config.min_floor_m2} m² (set --up or "
            "--unit if the scan is turned or scaled wrongly)"
        )
    found = [_floor_of(storey, surfaces, parts, columns.grid) for storey in storeys]
    return sorted(found, key=lambda floor: floor.floor_z_m)


@dataclass(frozen=True)
class _Parts:
    """Measures of each surface, all (parts,).

    `above` and `below` count the cells in and around it through which upright surfaces pass over
    and under it: a floor has a room's walls over it, a ceiling or a roof has them only under it.
    `pitch` is the median rise over run, 0 if there is no standing room.
    """

    area_m2: NDArray[np.float64]
    standing_m2: NDArray[np.float64]
    height_m: NDArray[np.float64]
    above: NDArray[np.float64]
    below: NDArray[np.float64]
    pitch: NDArray[np.float64]


def _measure(surfaces: Surfaces, columns: Columns, mesh: WorldMesh, min_floor_m2: float) -> _Parts:
    grid, count = columns.grid, surfaces.parts
    cell_m2 = grid.cell_m**2
    area = np.bincount(surfaces.part, minlength=count) * cell_m2
    standing = surfaces.clear_m >= STANDING_M
    standing_m2 = np.bincount(surfaces.part, weights=standing, minlength=count) * cell_m2
    # Without a single surface to stand on there is nothing to take a median of.
    height: Any = ndimage.median(surfaces.z_m, surfaces.part, np.arange(count)) if count else []
    above, below, pitch = np.zeros(count), np.zeros(count), np.zeros(count)
    walls = mesh.faces[np.abs(mesh.normals[:, 2]) < UPRIGHT_NORMAL_Z]
    reach = max(1, round(AROUND_M / grid.cell_m))
    for p in np.flatnonzero(standing_m2 >= min_floor_m2):
        selected = surfaces.part == p
        z = np.full(grid.rows * grid.columns, np.nan)
        z[surfaces.cell[selected]] = surfaces.z_m[selected]
        z = z.reshape(grid.shape)
        pitch[p] = _pitch(z, grid)
        near = grow(np.isfinite(z), reach)
        rises = np.concatenate([RISES_M, -RISES_M])
        marks = slice_marks(mesh.vertices, walls, grid, height[p] + rises)[near]
        upper = np.uint32((1 << len(RISES_M)) - 1)
        above[p] = np.bitwise_count(marks & upper).sum()
        below[p] = np.bitwise_count(marks & ~upper).sum()
    standing_m2 = standing_m2.astype(np.float64)
    return _Parts(area.astype(np.float64), standing_m2, np.asarray(height), above, below, pitch)


def _pitch(z_m: NDArray[np.float64], grid: GridSpec) -> float:
    """Return the median slope of a surface (rows, columns) with NaN outside it."""
    run = max(1, round(PITCH_OVER_M / grid.cell_m))
    along = z_m[run:, :-run] - z_m[:-run, :-run]
    across = z_m[:-run, run:] - z_m[:-run, :-run]
    slope = np.hypot(along, across) / (run * grid.cell_m)
    known = np.isfinite(slope)
    return float(np.median(slope[known])) if known.any() else 0.0


def _is_furniture(p: int, surfaces: Surfaces, parts: _Parts, grid: GridSpec) -> bool:
    """Return whether a surface stands over a larger one around it at furniture height."""
    if parts.area_m2[p] >= PLATFORM_M2:
        return False
    rise = parts.height_m[p] - parts.height_m
    lower = (rise > FURNITURE_M[0]) & (rise < FURNITURE_M[1]) & (parts.area_m2 > parts.area_m2[p])
    if not lower.any():
        return False
    mask = np.zeros(grid.rows * grid.columns, dtype=bool)
    mask[surfaces.cell[surfaces.part == p]] = True
    near = grow(mask.reshape(grid.shape), max(1, round(AROUND_M / grid.cell_m))).ravel()
    return bool((near[surfaces.cell] & lower[surfaces.part]).any())


def _floor_of(storey: list[int], surfaces: Surfaces, parts: _Parts, grid: GridSpec) -> ScannedFloor:
    """Combine a storey's floors and small pieces at their heights, seen between furniture."""
    heights = parts.height_m[storey]
    gap = np.abs(parts.height_m[:, None] - heights[None, :]).min(axis=1)
    chosen = (gap < PIECE_M) & (parts.pitch <= PITCH) & (parts.area_m2 >= 4 * grid.cell_m**2)
    chosen[storey] = True
    selected = chosen[surfaces.part]
    z = np.full(grid.rows * grid.columns, np.nan)
    # Where several lie in one cell the lowest is the floor: it is written last.
    order = np.argsort(-surfaces.z_m[selected], kind="stable")
    z[surfaces.cell[selected][order]] = surfaces.z_m[selected][order]
    z = without_pits(z.reshape(grid.shape), grid.cell_m)
    return ScannedFloor(grid, z, float(np.nanmedian(z)))


def averted_faces(
    floors: list[ScannedFloor], columns: Columns, normal_z: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return (F,) faces wound opposite to the floors: undersides of walls and furniture.

    None, if the floors' faces have inconsistent winding. A floor with a ceiling in its plane has no
    say: only its gaps would decide, and in them the ceiling lies alone.
    """
    total, count = 0.0, 0
    for floor in floors:
        _, some_up, some_down = _sides(floor, columns, normal_z > 0)
        decided = some_up != some_down
        if not _doubled(some_up, some_down):
            total, count = total + float(some_up[decided].sum()), count + int(decided.sum())
    share = total / count if count else 0.5
    if share >= ALIKE_SHARE:
        return normal_z < 0
    if share <= 1 - ALIKE_SHARE:
        return normal_z > 0
    return np.zeros(len(normal_z), dtype=bool)


def ceilings_in_floors(
    floors: list[ScannedFloor], columns: Columns, averted: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return (F,) averted faces in the plane of a floor, which may be seen in its place."""
    ceilings = np.zeros(len(averted), dtype=bool)
    for floor in floors:
        near, some_up, some_down = _sides(floor, columns, ~averted)
        if _doubled(some_up, some_down):
            under = near & averted[columns.face] & some_up[columns.cell]
            ceilings[columns.face[under]] = True
    return ceilings


def _sides(
    floor: ScannedFloor, columns: Columns, upward: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which hits lie in a floor's plane, and which cells have one of each side there."""
    cells = len(columns.start) - 1
    near = np.abs(columns.z - floor.z_m.ravel()[columns.cell]) < COPLANAR_M
    up = upward[columns.face]
    some_up, some_down = (
        np.bincount(columns.cell[near & side], minlength=cells) > 0 for side in (up, ~up)
    )
    return near, some_up, some_down


def _doubled(some_up: NDArray[np.bool_], some_down: NDArray[np.bool_]) -> bool:
    """Return whether most of a floor has a ceiling in its plane."""
    return bool((some_up != some_down).sum() < (some_up & some_down).sum())
