"""Find storeys: which floors belong together, and which of them are roofs."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.core.errors import SceneError
from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..floor.reference import without_pits
from ..grid.columns import Columns
from ..grid.world_mesh import WorldMesh
from .floor_parts import PITCH, FloorParts, measure_parts, walls_begin_m
from .surfaces import STANDING_M, Surfaces

# Floors of one storey differ by less than this; storeys by more.
STOREY_M = 1.5
# What has a ceiling or walls along this share is inside. The lowest storey needs neither.
INSIDE_SHARE = 0.3
# What is narrower than a disc of this radius and not walled in along this share is a shelf.
SHELF_M, CORRIDOR_SHARE = 0.75, 0.7
# A parapet is this much of the walls under a roof.
PARAPET_SHARE = 0.2
# The winding of faces is trusted if this share of the floor agrees.
ALIKE_SHARE = 0.7
# Exporters that put a ceiling in the plane of the floor above are that exact.
COPLANAR_M = 0.006
# Pieces of floor too small to be judged by themselves lie this near to a floor's height.
PIECE_M = 0.1
# Surfaces whose reasons an error gives, largest first.
SHOWN = 3


@dataclass(frozen=True)
class ScannedFloor:
    """The floor of one storey as scanned: heights (rows, columns), NaN = none; their median."""

    grid: GridSpec
    z_m: Array
    floor_z_m: float


def find_levels(
    surfaces: Surfaces, columns: Columns, mesh: WorldMesh, config: RepairConfig
) -> tuple[list[ScannedFloor], list[str]]:
    """Return the floors of all storeys, lowest first, and a line for each roof left out.

    Raises:
        SceneError: nothing here can be stood on; gives the reason for each large surface.
    """
    parts = measure_parts(surfaces, columns, mesh, config.min_floor_m2)
    reasons = [parts.why_no_floor(p, config.min_floor_m2) for p in range(surfaces.parts)]
    floors = [int(p) for p in np.argsort(-parts.standing_m2, kind="stable") if not reasons[p]]
    ceilings, roofs = _ceilings_and_roofs(floors, parts)
    if config.allow_roof:
        open_sky = {p for p in ceilings if parts.ceiled_share[p] < INSIDE_SHARE}
        ceilings, roofs = ceilings - open_sky, set()
    floors = [p for p in floors if p not in ceilings]
    if not floors:
        for p in np.flatnonzero(parts.standing_m2 >= config.min_floor_m2):
            if parts.over_walls(p):
                reasons[p] = "has walls only under it, like a ceiling or a roof"
        raise SceneError(_no_floor(parts, reasons, mesh))
    storeys: list[list[int]] = []
    for p in (p for p in floors if p not in roofs):
        for storey in storeys:
            if abs(parts.height_m[storey[0]] - parts.height_m[p]) < STOREY_M:
                storey.append(p)
                break
        else:
            storeys.append([p])
    levels = [_floor_of(storey, surfaces, parts, columns.grid) for storey in storeys]
    shelves = {p for p in roofs if _shelf(p, parts)}
    notes = [
        f"{parts.standing_m2[p]:.1f} m² at {parts.height_m[p]:.2f} m are taken for a roof: neither "
        "walls nor a ceiling stand over them, and no stairs lead there; --allow-roof makes them a "
        "level"
        for p in sorted(roofs - shelves, key=lambda p: parts.height_m[p])
    ]
    if shelves:
        area = sum(parts.standing_m2[p] for p in shelves)
        notes.append(
            f"{area:.1f} m² are taken for shelves ({len(shelves)}): narrow, not walled in, and no "
            "stairs lead there; --allow-roof makes them levels"
        )
    return sorted(levels, key=lambda level: level.floor_z_m), notes


def _ceilings_and_roofs(floors: list[int], parts: FloorParts) -> tuple[set[int], set[int]]:
    """Return the surfaces among `floors` that no stairs lead to and that are no floors.

    Ceilings only have walls under them. Roofs lie above the lowest storey under the open sky and
    without walls, have no more than a parapet, or are as narrow as shelves.
    """
    inside = [p for p in floors if not parts.over_walls(p)]
    lowest = min((parts.height_m[p] for p in inside), default=0.0) + STOREY_M
    sure = {
        p
        for p in inside
        if parts.height_m[p] < lowest
        or (
            max(parts.ceiled_share[p], parts.walled_share[p]) >= INSIDE_SHARE
            and not _shelf(p, parts)
        )
    }
    reached = {int(parts.stairs[p]) for p in sure}
    others = {p for p in floors if p not in sure and int(parts.stairs[p]) not in reached}
    parapets = {p for p in others if parts.above[p] > PARAPET_SHARE * parts.below[p] > 0}
    ceilings = {p for p in others if parts.over_walls(p)}
    return ceilings - parapets, (others - ceilings) | parapets


def _shelf(p: int, parts: FloorParts) -> bool:
    return bool(parts.widest_m[p] < SHELF_M and parts.walled_share[p] < CORRIDOR_SHARE)


def _no_floor(parts: FloorParts, reasons: list[str], mesh: WorldMesh) -> str:
    """Return what is wrong with the largest level surfaces, and what may help."""
    largest = [p for p in np.argsort(-parts.area_m2, kind="stable") if parts.area_m2[p] >= 0.01]
    reasons_of_largest = [
        f"{parts.area_m2[p]:.2f} m² at {parts.height_m[p]:.2f} m {reasons[p]}"
        for p in largest[:SHOWN]
    ]
    begin = walls_begin_m(mesh)
    own = (
        ""
        if begin is None
        else f"if the building has none of its own, lay one where its walls begin: --floor "
        f"{begin:.2f}; "
    )
    return (
        f"no floor found ({'; '.join(reasons_of_largest) or 'no level surface'}; a floor needs "
        f"{STANDING_M} m of free height): {own}set --up or --unit if the scan is turned or scaled "
        "wrongly"
    )


def _floor_of(
    storey: list[int], surfaces: Surfaces, parts: FloorParts, grid: GridSpec
) -> ScannedFloor:
    """Combine a storey's floors and small pieces at their heights, seen between furniture."""
    heights = parts.height_m[storey]
    gap = np.abs(parts.height_m[:, None] - heights[None, :]).min(axis=1)
    chosen = (gap < PIECE_M) & (parts.pitch <= PITCH) & (parts.area_m2 >= 4 * grid.cell_m**2)
    chosen[storey] = True
    selected = np.flatnonzero(chosen[surfaces.part])
    own = np.isin(surfaces.part[selected], storey)
    z = np.full(grid.rows * grid.columns, np.nan)
    # Where several lie in one cell the lowest is the floor: it is written last. Pieces count only
    # where there is no floor: under it they are the underside of its slab.
    order = selected[np.lexsort((-surfaces.z_m[selected], own))]
    z[surfaces.cell[order]] = surfaces.z_m[order]
    z = without_pits(z.reshape(grid.shape), grid.cell_m)
    return ScannedFloor(grid, z, float(np.nanmedian(z)))


def averted_faces(floors: list[ScannedFloor], columns: Columns, normal_z: Array) -> Mask:
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


def ceilings_in_floors(floors: list[ScannedFloor], columns: Columns, averted: Mask) -> Mask:
    """Return (F,) averted faces in the plane of a floor, which may be seen in its place."""
    ceilings = np.zeros(len(averted), dtype=bool)
    for floor in floors:
        near, some_up, some_down = _sides(floor, columns, ~averted)
        if _doubled(some_up, some_down):
            under = near & averted[columns.face] & some_up[columns.cell]
            ceilings[columns.face[under]] = True
    return ceilings


def _sides(floor: ScannedFloor, columns: Columns, upward: Mask) -> tuple[Mask, Mask, Mask]:
    """Return which hits lie in a floor's plane, and which cells have one of each side there."""
    cells = len(columns.start) - 1
    near = np.abs(columns.z - floor.z_m.ravel()[columns.cell]) < COPLANAR_M
    up = upward[columns.face]
    some_up, some_down = (
        np.bincount(columns.cell[near & side], minlength=cells) > 0 for side in (up, ~up)
    )
    return near, some_up, some_down


def _doubled(some_up: Mask, some_down: Mask) -> bool:
    """Return whether most of a floor has a ceiling in its plane."""
    return bool((some_up != some_down).sum() < (some_up & some_down).sum())
