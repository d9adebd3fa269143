"""Evidence per cell of a level: floor, walls, ceiling, furniture, depth below."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import I32, Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.columns import Columns
from ..grid.height_field import smooth
from ..grid.morphology import nearest_in
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from .reference import remove_narrow

# Surfaces this near to the reference height cover a floor, if they are not upright.
COVER_M = 0.03
COVER_NORMAL_Z = 0.2
# Heights above the floor at which walls are looked for: a wall passes most of the lower ones, or,
# over windows, doors and furniture that hid it, most of the upper ones.
WALL_HEIGHTS_M = np.array([0.25, 0.45, 0.65, 0.85, 1.05, 1.25, 1.45, 1.65, 1.85])
LINTEL_HEIGHTS_M = np.array([2.05, 2.25, 2.45])
WALL_SHARE = 0.6
OVERHEAD_M = 1.6
# Between a floor and the ceiling of the storey below lies no more than this.
SLAB_M = 0.6
# Depths under the floor; a shaft's walls pass most of them.
DEPTHS_M = np.array([0.9, 1.3, 1.7])
# A sill is level and higher than the foot of a wall.
SILL_NORMAL_Z, SILL_M = 0.7, 0.15


@dataclass(frozen=True)
class Evidence:
    """Facts per fine cell of one level, all (rows, columns).

    Attributes:
        reference_m: smooth floor height where scanned, NaN elsewhere.
        z_m: height of the covering surface, NaN where none.
        face: its face, −1 where none.
        covered: the cell has a floor.
        wall: a wall stands in the cell.
        lintel: a wall passes over the cell, above a door, a window or what hid its lower part.
        overhead: something hangs above head height: ceiling, roof, upper storey.
        furniture: something lies between the floor and head height.
        structure: the lowest surface under head height is labelled as wall or window: a sill.
        below: the next surface under the level lies deeper than a floor slab is thick.
        bare: nothing lies under the level as near as a floor slab is thick.
        sunk: upright surfaces go down deep under the level.
    """

    reference_m: Array
    z_m: Array
    face: I32
    covered: Mask
    wall: Mask
    lintel: Mask
    overhead: Mask
    furniture: Mask
    structure: Mask
    below: Mask
    bare: Mask
    sunk: Mask


def gather_evidence(
    mesh: WorldMesh,
    columns: Columns,
    scanned_z_m: Array,
    floor_z_m: float,
    *,
    ignore: Mask,
    structure: Mask,
    bump_width_m: float,
    bump_height_m: float,
    cover_m: float = COVER_M,
) -> Evidence:
    """Collect the facts of a level's cells.

    Args:
        scanned_z_m: (rows, columns) heights of the surely known floor, NaN elsewhere.
        floor_z_m: the level's median height.
        ignore, structure: (F,) faces that are no floor, and faces labelled as wall or window.
        bump_width_m, bump_height_m: narrower features are not part of the reference, unless they
            deviate from it by more.
        cover_m: a floor may deviate this far from the reference.
    """
    cell_m = columns.grid.cell_m
    plain = remove_narrow(scanned_z_m, cell_m, bump_width_m, bump_height_m)
    # Twice: each round averages few cells, and only such that no step lies between.
    reference = smooth(smooth(plain))
    everywhere = reference[nearest_in(np.isfinite(reference))]
    flat = (np.abs(mesh.normals[:, 2]) >= COVER_NORMAL_Z) & ~ignore
    z, face = _cover(columns, flat, everywhere.ravel(), cover_m)
    shape = columns.grid.shape
    z, face = z.reshape(shape), face.reshape(shape)
    above = columns.z - everywhere.ravel()[columns.cell]
    wall, lintel = _walls(mesh, columns.grid, floor_z_m)

    def any_in(low: float, high: float) -> Mask:
        hit = np.zeros(shape[0] * shape[1], dtype=bool)
        hit[columns.cell[(above > low) & (above < high)]] = True
        return hit.reshape(shape)

    depths = slice_marks(mesh.vertices, mesh.faces, columns.grid, floor_z_m - DEPTHS_M)
    bare = ~any_in(-SLAB_M, -cover_m)
    sills = structure & (np.abs(mesh.normals[:, 2]) >= SILL_NORMAL_Z)
    return Evidence(
        reference_m=reference,
        z_m=z,
        face=face,
        covered=face >= 0,
        wall=wall,
        lintel=lintel,
        overhead=any_in(OVERHEAD_M, np.inf),
        furniture=any_in(cover_m, OVERHEAD_M),
        structure=_lowest(columns, above, cover_m, sills).reshape(shape) & ~any_in(cover_m, SILL_M),
        below=any_in(-np.inf, -SLAB_M) & bare,
        bare=bare,
        sunk=np.bitwise_count(depths) >= 2,
    )


def _lowest(columns: Columns, above_m: Array, cover_m: float, chosen: Mask) -> Mask:
    """Return (cells,) whether the lowest surface below head height is among the chosen faces."""
    over = (above_m > cover_m) & (above_m < OVERHEAD_M)
    cell = columns.cell[over]
    # Samples are sorted upwards in each cell: the first one over the floor is the lowest.
    first = np.ones(len(cell), dtype=bool)
    first[1:] = cell[1:] != cell[:-1]
    result = np.zeros(len(columns.start) - 1, dtype=bool)
    result[cell[first]] = chosen[columns.face[over][first]]
    return result


def _walls(mesh: WorldMesh, grid: GridSpec, floor_z_m: float) -> tuple[Mask, Mask]:
    heights = np.concatenate([WALL_HEIGHTS_M, LINTEL_HEIGHTS_M]) + floor_z_m
    marks = slice_marks(mesh.vertices, mesh.faces, grid, heights)
    lower = np.uint32((1 << len(WALL_HEIGHTS_M)) - 1)
    tall = np.bitwise_count(marks & lower) >= WALL_SHARE * len(WALL_HEIGHTS_M)
    high = np.bitwise_count(marks & ~lower) >= 2
    return tall, high & ~tall


def _cover(columns: Columns, flat: Mask, reference_m: Array, limit_m: float) -> tuple[Array, I32]:
    """Find per cell the height and face of the flat sample nearest to a reference height.

    Of equally near samples the uppermost is taken; NaN and -1 stand where none is within the limit.
    """
    z_out = np.full(len(reference_m), np.nan)
    face_out = np.full(len(reference_m), -1, dtype=np.int32)
    gap = np.abs(columns.z - reference_m[columns.cell])
    near = np.flatnonzero(flat[columns.face] & (gap <= limit_m))
    # The last one written to a cell stays.
    order = near[np.lexsort((near, -gap[near]))]
    z_out[columns.cell[order]] = columns.z[order]
    face_out[columns.cell[order]] = columns.face[order]
    return z_out, face_out
