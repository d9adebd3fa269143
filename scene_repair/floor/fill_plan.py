"""Plan which cells of a level are filled, with which heights, and which faces are its floor."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import I32, I64, Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.columns import Columns
from ..grid.morphology import closing, grow, label, nearest_in
from ..grid.world_mesh import WorldMesh
from .evidence import COVER_M, COVER_NORMAL_Z, Evidence
from .holes import Hole, floors_run_under_walls
from .outline import face_outline
from .reference import STEP_M, fill_heights

# Known floor within this distance shapes the heights inside a hole.
REACH_M = 0.75
# Faces that slope away from the floor at the rim of a hole are covered up to this far from it.
SLOPE_M = 0.25
# Steeper than any ramp.
SLOPE_NORMAL_Z = 0.98
# Smaller pieces of floor between walls and lintels are not rooms.
ROOM_M2 = 0.5


@dataclass(frozen=True)
class FillPlan:
    """What is filled on a level; all maps (rows, columns) over `grid`.

    Attributes:
        fill, leave: holes that get a floor and thin gaps beside them, and holes that stay open.
        target: `fill`, cracks, and cells at its rim whose face slopes away.
        height_m: reference height everywhere: modelled in holes, the nearest floor's elsewhere.
        rooms: number of the room that each cell lies in or is nearest to, from 1.
        floor_faces: (n,) faces of the mesh that are floor.
    """

    grid: GridSpec
    fill: Mask
    leave: Mask
    target: Mask
    height_m: Array
    rooms: I32
    floor_faces: I64

    @property
    def patch_height_m(self) -> Array:
        """Return heights for patches: beyond a step those of the nearest target cell."""
        if not self.target.any():
            return self.height_m
        level = self.height_m[nearest_in(self.target)]
        return np.where(np.abs(self.height_m - level) <= STEP_M, self.height_m, level)


def plan_fill(
    mesh: WorldMesh,
    columns: Columns,
    evidence: Evidence,
    *,
    holes: list[Hole],
    passable: Mask,
    ignore: Mask,
) -> FillPlan:
    """Plan the repair of a level.

    `passable` (rows, columns) lies under lintels and bridged walls; `ignore` (F,) is no floor.
    """
    grid = columns.grid
    fill, leave = np.zeros((2, *grid.shape), dtype=bool)
    for hole in holes:
        (fill if hole.fill else leave)[hole.window] |= hole.cells
    height_m = heights_everywhere(evidence, fill, grid)
    under = passable | evidence.wall if floors_run_under_walls(evidence, grid) else passable
    # Next to filled cells with floor on both sides: a wardrobe's front, a doorway.
    floor = np.pad(fill | evidence.covered, 4)
    thin = closing(floor, (3, 3))[4:-4, 4:-4]
    thin |= closing(floor, (7, 7))[4:-4, 4:-4] & under & ~grow(leave)
    fill = fill | (thin & ~evidence.covered & grow(fill, 4))
    # Faces that leave the floor's height between their corners lie over pits of a scan.
    off = np.abs(columns.z - height_m.ravel()[columns.cell]) > COVER_M
    off &= np.abs(mesh.normals[columns.face, 2]) < SLOPE_NORMAL_Z
    bridging = columns.face[off & fill.ravel()[columns.cell]]
    floor_faces = np.setdiff1d(_floor_faces(mesh, height_m, grid, ignore), bridging)
    floor = fill | evidence.covered
    cracked = _cracked(mesh, floor_faces, floor, grid)
    return FillPlan(
        grid=grid,
        fill=fill,
        leave=leave,
        target=fill | cracked | _sloping(evidence, floor_faces, fill, grid),
        height_m=height_m,
        rooms=_rooms(floor & ~evidence.wall & ~passable, grid),
        floor_faces=floor_faces,
    )


def heights_everywhere(evidence: Evidence, missing: Mask, fine: GridSpec) -> Array:
    """Return reference heights: modelled in the `missing` cells, the nearest floor's elsewhere."""
    # Walls between a hole's parts and its rim take part, so that heights pass under them.
    missing = missing | evidence.wall & ~np.isfinite(evidence.reference_m) & grow(missing)
    heights = np.where(missing, np.nan, evidence.reference_m)
    filled = fill_heights(heights, missing, round(REACH_M / fine.cell_m))
    finite = np.isfinite(filled)
    return filled[nearest_in(finite)]


def _floor_faces(mesh: WorldMesh, height_m: Array, fine: GridSpec, ignore: Mask) -> I64:
    """Return the faces all of whose corners lie at the reference height, upright ones apart."""
    z = mesh.vertices[:, 2]
    low, high = height_m.min() - COVER_M, height_m.max() + COVER_M
    within = ((z >= low) & (z <= high))[mesh.faces].all(axis=1)
    flat = np.abs(mesh.normals[:, 2]) >= COVER_NORMAL_Z
    chosen = np.flatnonzero(within & flat & ~ignore)
    corners = mesh.vertices[mesh.faces[chosen]]
    # Compared a little inside of the face: at a step, both floors have corners on its edge.
    inward = corners.mean(axis=1, keepdims=True)[..., :2] - corners[..., :2]
    length = np.linalg.norm(inward, axis=-1, keepdims=True)
    inward *= np.minimum(0.5 * fine.cell_m / np.maximum(length, 1e-12), 1.0)
    cell = np.clip(fine.cell_of(corners[..., :2] + inward), 0, np.array(fine.shape) - 1)
    gap = np.abs(corners[..., 2] - height_m[cell[..., 0], cell[..., 1]])
    return chosen[(gap <= COVER_M).all(axis=1)]


def _cracked(mesh: WorldMesh, floor_faces: I64, floor: Mask, fine: GridSpec) -> Mask:
    """Return cells well inside the floor through which open edges run; most meet a neighbour."""
    edges = face_outline(mesh.faces[floor_faces], mesh.normals[floor_faces, 2] > 0)
    if not len(edges):
        return np.zeros(fine.shape, dtype=bool)
    a, b = mesh.vertices[edges[:, 0], :2], mesh.vertices[edges[:, 1], :2]
    steps = np.ceil(np.linalg.norm(b - a, axis=1) / (0.5 * fine.cell_m)).astype(np.int64) + 1
    start = np.repeat(np.cumsum(steps) - steps, steps)
    t = ((np.arange(len(start)) - start + 0.5) / np.repeat(steps, steps))[:, None]
    points = np.repeat(a, steps, axis=0) * (1 - t) + np.repeat(b, steps, axis=0) * t
    return cells_at(points, fine) & ~grow(~floor)


def _sloping(evidence: Evidence, floor_faces: I64, fill: Mask, fine: GridSpec) -> Mask:
    """Return cells at the rim of filled ones whose face slopes away, which would show a slit."""
    part = evidence.covered & ~np.isin(evidence.face, floor_faces)
    if not (part.any() and fill.any()):
        return np.zeros(fine.shape, dtype=bool)
    return grow(fill, round(SLOPE_M / fine.cell_m), within=part | fill) & part


def _rooms(floor: Mask, fine: GridSpec) -> I32:
    """Return the number of the room, from 1, that each cell lies in or is nearest to."""
    parts, count = label(floor)
    large = np.bincount(parts.ravel(), minlength=count + 1) * fine.cell_m**2 >= ROOM_M2
    large[0] = False
    inside = large[parts]
    return parts[nearest_in(inside)] if inside.any() else np.ones(fine.shape, dtype=np.int32)


def cells_at(points_xy_m: Array, fine: GridSpec) -> Mask:
    """Return cells in which any of the points (N, 2) lies."""
    cells = fine.cell_of(points_xy_m)
    cells = cells[fine.inside(cells)]
    mask = np.zeros(fine.shape, dtype=bool)
    mask[cells[:, 0], cells[:, 1]] = True
    return mask
