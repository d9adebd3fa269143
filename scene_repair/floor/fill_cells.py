"""Which cells of a level are filled, with which heights, and which faces are its floor."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...formats.scene.grid import GridSpec
from ..grid.columns import Columns
from ..grid.morphology import grow, label, nearest_in
from ..grid.world_mesh import WorldMesh
from .evidence import COVER_M, COVER_NORMAL_Z, Evidence
from .holes import Hole
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


def heights_everywhere(
    evidence: Evidence, holes: list[Hole], fine: GridSpec
) -> NDArray[np.float64]:
    """Return reference heights in all cells: modelled in holes, the nearest floor's elsewhere."""
    missing = np.zeros(fine.shape, dtype=bool)
    for hole in holes:
        if hole.fill:
            missing[hole.window] |= hole.cells
    # Walls between a hole's parts and its rim take part, so that heights pass under them.
    missing |= evidence.wall & ~np.isfinite(evidence.reference_m) & grow(missing)
    known = np.where(missing, np.nan, evidence.reference_m)
    filled = fill_heights(known, missing, round(REACH_M / fine.cell_m))
    have = np.isfinite(filled)
    return filled[nearest_in(have)]


def thin_gaps(
    fill: NDArray[np.bool_], covered: NDArray[np.bool_], passable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return cells next to filled ones with floor on both sides: a wardrobe's front, a doorway."""
    floor = np.pad(fill | covered, 4)
    thin = ndimage.binary_closing(floor, structure=np.ones((3, 3)))[4:-4, 4:-4]
    doorway = ndimage.binary_closing(floor, structure=np.ones((7, 7)))[4:-4, 4:-4] & passable
    return (thin | doorway) & ~covered & grow(fill, 4)


def heights_beside(height_m: NDArray[np.float64], fill: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return heights for patches: beyond a step those of the nearest filled cell."""
    if not fill.any():
        return height_m
    level = height_m[nearest_in(fill)]
    return np.where(np.abs(height_m - level) <= STEP_M, height_m, level)


def without_bridging(
    floor_faces: NDArray[np.int64],
    mesh: WorldMesh,
    columns: Columns,
    height_m: NDArray[np.float64],
    fill: NDArray[np.bool_],
) -> NDArray[np.int64]:
    """Leave out faces that leave the floor's height between their corners: over pits of a scan.

    Args:
        floor_faces: (n,) candidates.
        height_m: (rows, columns) reference heights everywhere.
        fill: (rows, columns) cells that are filled.
    """
    off = np.abs(columns.z - height_m.ravel()[columns.cell]) > COVER_M
    off &= np.abs(mesh.normals[columns.face, 2]) < SLOPE_NORMAL_Z
    return np.setdiff1d(floor_faces, columns.face[off & fill.ravel()[columns.cell]])


def floor_faces_of(
    mesh: WorldMesh, height_m: NDArray[np.float64], fine: GridSpec, ignore: NDArray[np.bool_]
) -> NDArray[np.int64]:
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


def cracked_cells(
    mesh: WorldMesh, floor_faces: NDArray[np.int64], floor: NDArray[np.bool_], fine: GridSpec
) -> NDArray[np.bool_]:
    """Return cells well inside the floor through which its open edges run: pinholes, cracks, seams.

    Most of these edges do meet a neighbour; the patch determines that from their outlines.
    """
    edges = face_outline(mesh.faces[floor_faces], mesh.normals[floor_faces, 2] > 0)
    if not len(edges):
        return np.zeros(fine.shape, dtype=bool)
    a, b = mesh.vertices[edges[:, 0], :2], mesh.vertices[edges[:, 1], :2]
    steps = np.ceil(np.linalg.norm(b - a, axis=1) / (0.5 * fine.cell_m)).astype(np.int64) + 1
    start = np.repeat(np.cumsum(steps) - steps, steps)
    t = ((np.arange(len(start)) - start + 0.5) / np.repeat(steps, steps))[:, None]
    points = np.repeat(a, steps, axis=0) * (1 - t) + np.repeat(b, steps, axis=0) * t
    return cells_at(points, fine) & ~grow(~floor)


def sloping_cells(
    evidence: Evidence,
    floor_faces: NDArray[np.int64],
    fill: NDArray[np.bool_],
    fine: GridSpec,
) -> NDArray[np.bool_]:
    """Return cells at the rim of filled ones whose face is near the floor's height only in part.

    Such a face slopes away beneath the patch or out of it; a patch that ended on it would leave a
    slit above the slope.
    """
    part = evidence.covered & ~np.isin(evidence.face, floor_faces)
    if not (part.any() and fill.any()):
        return np.zeros(fine.shape, dtype=bool)
    return grow(fill, round(SLOPE_M / fine.cell_m), within=part | fill) & part


def room_of_cells(floor: NDArray[np.bool_], fine: GridSpec) -> NDArray[np.int32]:
    """Return the number of the room that each cell lies in or is nearest to, from 1.

    Args:
        floor: (rows, columns) floor without what lies under walls and lintels.
        fine: the cells.
    """
    parts, count = label(floor)
    large = np.bincount(parts.ravel(), minlength=count + 1) * fine.cell_m**2 >= ROOM_M2
    large[0] = False
    inside = large[parts]
    return parts[nearest_in(inside)] if inside.any() else np.ones(fine.shape, dtype=np.int32)


def cells_at(points_xy_m: NDArray[np.float64], fine: GridSpec) -> NDArray[np.bool_]:
    """Return cells in which any of the points (N, 2) lies."""
    cells = fine.cell_of(points_xy_m)
    cells = cells[fine.inside(cells)]
    mask = np.zeros(fine.shape, dtype=bool)
    mask[cells[:, 0], cells[:, 1]] = True
    return mask
