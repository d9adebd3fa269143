"""Repair of one level's floor: flatten, find holes, patch, paint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..formats.grid import GridSpec
from .columns import sample_columns
from .config import RepairConfig
from .coverage import COVER_M, Evidence, gather_evidence
from .flatten import Bump, flatten_bumps
from .floor_paint import paint_floor, uv_on
from .holes import Hole, find_holes
from .levels import ScannedFloor
from .maps import grow, nearest_in
from .patch import build_patch
from .patch_region import patch_region
from .reference import fill_heights
from .scan import ScanMaterial, ScanObject
from .shading import Looks
from .world_mesh import WorldMesh

# Known floor within this distance shapes the heights inside a hole.
REACH_M = 0.75


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
        patch_polygons: outlines of the added floor.
        patch_area_m2: its area.
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
    patch_polygons: list[NDArray[np.float64]]
    patch_area_m2: float


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

    width = config.bump_width_m
    z, floor_z = scanned.z_m, scanned.floor_z_m
    columns = sample_columns(mesh.vertices, mesh.faces, fine)
    limit = config.bump_height_m
    evidence = gather_evidence(mesh, columns, z, floor_z, ignore, structure, width, limit)
    everywhere = _everywhere(evidence, [], fine)
    mesh, bumps = flatten_bumps(mesh, columns, evidence, everywhere, config)
    if bumps:
        columns = sample_columns(mesh.vertices, mesh.faces, fine)
    evidence = gather_evidence(mesh, columns, z, floor_z, ignore, structure, width)
    holes = find_holes(evidence, fine)
    everywhere = _everywhere(evidence, holes, fine)
    fill = np.zeros(fine.shape, dtype=bool)
    leave = np.zeros(fine.shape, dtype=bool)
    for hole in holes:
        (fill if hole.fill else leave)[hole.window] |= hole.cells
    fill |= _thin_gaps(fill, evidence)
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
        [],
        0.0,
    )
    if not fill.any():
        return result
    floor_faces = _floor_faces(mesh, everywhere, fine, ignore)
    region = patch_region(mesh, fill, ~leave, evidence.wall, fine, floor_z)
    patch = build_patch(mesh, floor_faces, region, everywhere, fine)
    image, texels = paint_floor(
        mesh,
        Looks(materials),
        floor_faces,
        grow(fill, 2),
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
    return replace(
        result,
        mesh=patched,
        materials=(*materials, ScanMaterial(f"floor_patch_{index}", (1.0, 1.0, 1.0), image)),
        objects=(*objects, ScanObject(f"FloorPatch_{index}", "floor")),
        patch_polygons=patch.polygons,
        patch_area_m2=patch.area_m2,
    )


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


def _thin_gaps(fill: NDArray[np.bool_], evidence: Evidence) -> NDArray[np.bool_]:
    """Cells of upright faces with floor or filling on both sides: a wardrobe's front, a screen."""
    floor = fill | evidence.covered
    closed = ndimage.binary_closing(floor, structure=np.ones((3, 3)))
    under = ndimage.binary_closing(floor, structure=np.ones((7, 7))) & evidence.lintel
    return (closed | under) & ~floor & grow(fill, 2)


def _floor_faces(
    mesh: WorldMesh, height_m: NDArray[np.float64], fine: GridSpec, ignore: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Faces all of whose corners lie at the reference height."""
    cell = fine.cell_of(mesh.vertices[:, :2])
    cell = np.clip(cell, 0, np.array(fine.shape) - 1)
    near = np.abs(mesh.vertices[:, 2] - height_m[tuple(cell.T)]) <= COVER_M
    return np.flatnonzero(near[mesh.faces].all(axis=1) & ~ignore)
