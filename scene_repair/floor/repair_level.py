"""Repair of one level's floor: flatten, find holes, patch, paint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..grid.columns import sample_columns
from ..grid.morphology import grow, label, nearest_in
from ..grid.world_mesh import WorldMesh
from ..paint.floor_texture import paint_floor, uv_on
from ..paint.shading import Looks
from ..scan.record import ScanMaterial, ScanObject
from .evidence import COVER_M, COVER_NORMAL_Z, Evidence, gather_evidence
from .flatten import Bump, flatten_bumps
from .holes import Hole, find_holes, floors_run_under_walls
from .levels import ScannedFloor
from .outline import face_outline
from .patch import Patch, build_patch
from .patch_region import patch_region
from .reference import STEP_M, fill_heights

# Known floor within this distance shapes the heights inside a hole.
REACH_M = 0.75
# Faces that slope away from the floor at the rim of a hole are covered up to this far from it.
SLOPE_M = 0.25
# Steeper than any ramp.
SLOPE_NORMAL_Z = 0.98
# Smaller pieces of floor between walls and lintels are no rooms.
ROOM_M2 = 0.5


@dataclass(frozen=True)
class Crack:
    """A filled gap finer than the grid: its outer ring (n, 2) [m] and area."""

    ring_xy_m: NDArray[np.float64]
    area_m2: float


@dataclass(frozen=True)
class RepairedFloor:
    """What became of one level's floor.

    Attributes:
        mesh: the scan with bumps pressed and patches added.
        materials, objects: as in `Scan`, extended by the patches' own.
        fine: the grid of the following maps.
        height_m: (rows, columns) floor height, NaN where there is no floor.
        floor_z_m: median height.
        scanned: (rows, columns) bool floor that was scanned.
        scanned_faces: the faces that it consists of.
        holes: every gap, filled or left.
        bumps: what was flattened.
        patch_area_m2: area of the added floor.
        cracks: filled gaps finer than the grid.
    """

    mesh: WorldMesh
    materials: tuple[ScanMaterial, ...]
    objects: tuple[ScanObject, ...]
    fine: GridSpec
    height_m: NDArray[np.float64]
    floor_z_m: float
    scanned: NDArray[np.bool_]
    scanned_faces: NDArray[np.int64]
    holes: list[Hole]
    bumps: list[Bump]
    patch_area_m2: float
    cracks: list[Crack]


def repair_floor(
    mesh: WorldMesh,
    materials: tuple[ScanMaterial, ...],
    objects: tuple[ScanObject, ...],
    scanned: ScannedFloor,
    ignore: NDArray[np.bool_],
    structure: NDArray[np.bool_],
    index: int,
    config: RepairConfig,
) -> RepairedFloor:
    """Repair the floor of one level.

    Args:
        mesh: the scan, with the repairs of lower levels.
        materials: what its faces point to.
        objects: what its faces point to.
        scanned: the level's floor as found.
        ignore: (F,) faces that are no floor.
        structure: (F,) faces labelled as wall or window.
        index: number of the level, for names.
        config: limits.
    """
    fine = scanned.grid

    size = config.bump_width_m, config.bump_height_m + config.bump_tolerance_m
    z, floor_z = scanned.z_m, scanned.floor_z_m
    columns = sample_columns(mesh.vertices, mesh.faces, fine)
    limit = config.bump_height_m
    evidence = gather_evidence(mesh, columns, z, floor_z, ignore, structure, *size, limit)
    everywhere = _everywhere(evidence, [], fine)
    mesh, bumps = flatten_bumps(mesh, columns, evidence, everywhere, config)
    if bumps:
        columns = sample_columns(mesh.vertices, mesh.faces, fine)
    evidence = gather_evidence(mesh, columns, z, floor_z, ignore, structure, *size)
    holes, passable = find_holes(evidence, fine)
    everywhere = _everywhere(evidence, holes, fine)
    fill = np.zeros(fine.shape, dtype=bool)
    leave = np.zeros(fine.shape, dtype=bool)
    for hole in holes:
        (fill if hole.fill else leave)[hole.window] |= hole.cells
    under = passable | evidence.wall if floors_run_under_walls(evidence, fine) else passable
    fill |= _thin_gaps(fill, evidence.covered, under & ~grow(leave))
    height = np.where(evidence.covered, evidence.reference_m, np.nan)
    height = np.where(evidence.covered & ~np.isfinite(height), everywhere, height)
    height = np.where(fill, everywhere, height)
    result = RepairedFloor(
        mesh,
        materials,
        objects,
        fine,
        height,
        scanned.floor_z_m,
        evidence.covered,
        np.unique(evidence.face[evidence.covered]).astype(np.int64),
        holes,
        bumps,
        0.0,
        [],
    )
    floor_faces = _floor_faces(mesh, everywhere, fine, ignore)
    # Not those that leave the floor's height between their corners: over pits of a scan.
    off = np.abs(columns.z - everywhere.ravel()[columns.cell]) > COVER_M
    off &= np.abs(mesh.normals[columns.face, 2]) < SLOPE_NORMAL_Z
    floor_faces = np.setdiff1d(floor_faces, columns.face[off & fill.ravel()[columns.cell]])
    cracked = _cracked(mesh, floor_faces, fill | evidence.covered, fine)
    wanted = fill | cracked | _sloping(evidence, floor_faces, fill, fine)
    region = patch_region(mesh, wanted, ~leave, evidence.wall, fine, floor_z)
    patch = build_patch(mesh, floor_faces, region, _beside(everywhere, wanted), fine)
    if not patch.pieces:
        return result
    outlines = np.concatenate([ring for piece in patch.pieces for ring in piece])
    image, texels = paint_floor(
        mesh,
        Looks(materials),
        floor_faces,
        grow(fill | _cells_at(outlines, fine), 2),
        _rooms((evidence.covered | fill) & ~evidence.wall & ~passable, fine),
        fine,
        config.patch_texel_m,
        config.max_texture_px,
    )
    joint = np.concatenate([mesh.vertices, patch.vertices])
    patched = mesh.extended(
        patch.vertices,
        patch.faces,
        uv_on(texels, joint[patch.faces][..., :2]),
        len(materials),
        len(objects),
    )
    holes, cracks = _shared_out(patch, holes, fine)
    return replace(
        result,
        holes=holes,
        mesh=patched,
        materials=(*materials, ScanMaterial(f"floor_patch_{index}", (1.0, 1.0, 1.0), image)),
        objects=(*objects, ScanObject(f"FloorPatch_{index}", "floor")),
        patch_area_m2=sum(patch.area_m2),
        cracks=cracks,
    )


def _beside(height_m: NDArray[np.float64], fill: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Heights for patches: beyond a step those of the nearest filled cell."""
    if not fill.any():
        return height_m
    level = height_m[nearest_in(fill)]
    return np.where(np.abs(height_m - level) <= STEP_M, height_m, level)


def _rooms(floor: NDArray[np.bool_], fine: GridSpec) -> NDArray[np.int32]:
    """Number of the room that each cell lies in or is nearest to, from 1.

    Args:
        floor: (rows, columns) floor without what lies under walls and lintels.
        fine: the cells.
    """
    parts, count = label(floor)
    large = np.bincount(parts.ravel(), minlength=count + 1) * fine.cell_m**2 >= ROOM_M2
    large[0] = False
    inside = large[parts]
    return parts[nearest_in(inside)] if inside.any() else np.ones(fine.shape, dtype=np.int32)


def _everywhere(evidence: Evidence, holes: list[Hole], fine: GridSpec) -> NDArray[np.float64]:
    """Reference heights in all cells: modelled in holes, that of the nearest floor elsewhere."""
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


def _thin_gaps(
    fill: NDArray[np.bool_], covered: NDArray[np.bool_], passable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Cells next to filled ones with floor on both sides: a wardrobe's front, a doorway."""
    floor = np.pad(fill | covered, 4)
    thin = ndimage.binary_closing(floor, structure=np.ones((3, 3)))[4:-4, 4:-4]
    doorway = ndimage.binary_closing(floor, structure=np.ones((7, 7)))[4:-4, 4:-4] & passable
    return (thin | doorway) & ~covered & grow(fill, 4)


def _sloping(
    evidence: Evidence,
    floor_faces: NDArray[np.int64],
    fill: NDArray[np.bool_],
    fine: GridSpec,
) -> NDArray[np.bool_]:
    """Cells at the rim of filled ones whose face is near the floor's height only in part.

    Such a face slopes away beneath the patch or out of it; a patch that ended on it would leave a
    slit above the slope.
    """
    part = evidence.covered & ~np.isin(evidence.face, floor_faces)
    if not (part.any() and fill.any()):
        return np.zeros(fine.shape, dtype=bool)
    return grow(fill, round(SLOPE_M / fine.cell_m), within=part | fill) & part


def _cracked(
    mesh: WorldMesh, floor_faces: NDArray[np.int64], floor: NDArray[np.bool_], fine: GridSpec
) -> NDArray[np.bool_]:
    """Cells well inside the floor through which open edges of it run: pinholes, cracks, seams.

    Most of these edges fit to a neighbour all the same; the patch finds out by their outlines.
    """
    edges = face_outline(mesh.faces[floor_faces], mesh.normals[floor_faces, 2] > 0)
    if not len(edges):
        return np.zeros(fine.shape, dtype=bool)
    a, b = mesh.vertices[edges[:, 0], :2], mesh.vertices[edges[:, 1], :2]
    steps = np.ceil(np.linalg.norm(b - a, axis=1) / (0.5 * fine.cell_m)).astype(np.int64) + 1
    start = np.repeat(np.cumsum(steps) - steps, steps)
    t = ((np.arange(len(start)) - start + 0.5) / np.repeat(steps, steps))[:, None]
    points = np.repeat(a, steps, axis=0) * (1 - t) + np.repeat(b, steps, axis=0) * t
    return _cells_at(points, fine) & ~grow(~floor)


def _cells_at(points_xy_m: NDArray[np.float64], fine: GridSpec) -> NDArray[np.bool_]:
    """Cells in which any of the points (N, 2) lies."""
    cells = fine.cell_of(points_xy_m)
    cells = cells[fine.inside(cells)]
    mask = np.zeros(fine.shape, dtype=bool)
    mask[cells[:, 0], cells[:, 1]] = True
    return mask


def _shared_out(patch: Patch, holes: list[Hole], fine: GridSpec) -> tuple[list[Hole], list[Crack]]:
    """Holes with the area of what fills them, and the pieces that close none seen on the grid.

    A piece that closes several holes counts for each by its cells.
    """
    number = np.full(fine.shape, -1)
    for k, hole in enumerate(holes):
        if hole.fill:
            number[hole.window][hole.cells] = k
    filled = number >= 0
    near = grow(filled) if filled.any() else filled
    nearest = number[nearest_in(filled)] if filled.any() else number
    added, cracks = np.zeros(len(holes)), []
    for rings, area in zip(patch.pieces, patch.area_m2, strict=True):
        outer = max(rings, key=len)
        cells = fine.cell_of(np.concatenate(rings))
        cells = tuple(cells[fine.inside(cells)].T)
        mine = np.unique(nearest[cells][near[cells]])
        if not len(mine):
            cracks.append(Crack(outer, area))
            continue
        size = np.array([holes[k].cells.sum() for k in mine])
        added[mine] += area * size / size.sum()
    return [replace(h, added_m2=float(a)) for h, a in zip(holes, added, strict=True)], cracks


def _floor_faces(
    mesh: WorldMesh, height_m: NDArray[np.float64], fine: GridSpec, ignore: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Faces all of whose corners lie at the reference height, upright ones apart."""
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
