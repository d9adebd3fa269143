"""Repair one level's floor: flatten, find holes, patch, paint."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from PIL import Image

from ...formats.core.arrays import F32, I64, Array, Mask
from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..grid.columns import Columns, sample_columns, top_faces
from ..grid.morphology import grow, nearest_in
from ..grid.world_mesh import WorldMesh
from ..paint.floor_texture import paint_floor, uv_on
from ..paint.materials import MaterialSampler
from ..scan.record import ScanMaterial, ScanObject
from ..storeys.levels import ScannedFloor
from .evidence import Evidence, gather_evidence
from .fill_plan import cells_at, heights_everywhere, plan_fill
from .flatten import Bump, flatten_bumps
from .holes import Hole, find_holes
from .patch import Patch, build_patch
from .patch_region import patch_region


@dataclass(frozen=True)
class Crack:
    """A filled gap finer than the grid: its outer ring (n, 2) [m] and area."""

    ring_xy_m: Array
    area_m2: float


@dataclass(frozen=True)
class RepairedFloor:
    """The repaired floor of one level.

    Attributes:
        mesh: the scan with bumps pressed and patches added.
        materials, objects: as in `Scan`, extended by the patches' own.
        height_m: (rows, columns) floor height over `fine`, NaN where there is no floor.
        floor_z_m: median height.
        scanned, scanned_faces: (rows, columns) floor that was scanned, and its faces.
        holes, cracks: every gap, filled or left; filled ones finer than the grid.
        bumps: what was flattened.
        patch_area_m2: area of the added floor.
    """

    mesh: WorldMesh
    materials: tuple[ScanMaterial, ...]
    objects: tuple[ScanObject, ...]
    fine: GridSpec
    height_m: Array
    floor_z_m: float
    scanned: Mask
    scanned_faces: I64
    holes: list[Hole]
    bumps: list[Bump]
    patch_area_m2: float
    cracks: list[Crack]

    @property
    def scanned_area_m2(self) -> float:
        """Area of the floor that was scanned [m²], by cells."""
        return float(self.scanned.sum()) * self.fine.cell_m**2


def repair_floor(
    mesh: WorldMesh,
    materials: tuple[ScanMaterial, ...],
    objects: tuple[ScanObject, ...],
    scanned: ScannedFloor,
    *,
    ignore: Mask,
    structure: Mask,
    index: int,
    config: RepairConfig,
) -> RepairedFloor:
    """Repair the floor of one level.

    Args:
        mesh: the scan, with the repairs of lower levels.
        materials, objects: what its faces point to.
        ignore, structure: (F,) faces that are no floor, and faces labelled as wall or window.
        index: number of the level, for names.
    """
    fine = scanned.grid
    mesh, columns, evidence, bumps = _flattened(
        mesh, scanned, ignore=ignore, structure=structure, config=config
    )
    holes, passable = find_holes(evidence, fine)
    plan = plan_fill(mesh, columns, evidence, holes=holes, passable=passable, ignore=ignore)
    height = np.where(evidence.covered, evidence.reference_m, np.nan)
    height = np.where(evidence.covered & ~np.isfinite(height), plan.height_m, height)
    unpatched = RepairedFloor(
        mesh=mesh,
        materials=materials,
        objects=objects,
        fine=fine,
        height_m=np.where(plan.fill, plan.height_m, height),
        floor_z_m=scanned.floor_z_m,
        scanned=evidence.covered,
        scanned_faces=np.unique(evidence.face[evidence.covered]).astype(np.int64),
        holes=holes,
        bumps=bumps,
        patch_area_m2=0.0,
        cracks=[],
    )
    region = patch_region(
        mesh,
        fill=plan.target,
        reach=~plan.leave,
        wall=evidence.wall,
        grid=fine,
        floor_z_m=scanned.floor_z_m,
    )
    patch = build_patch(mesh, plan.floor_faces, region, plan.patch_height_m, fine)
    if not patch.pieces:
        return unpatched
    outlines = np.concatenate([ring for piece in patch.pieces for ring in piece])
    joint = np.concatenate([mesh.vertices, patch.vertices])
    corners = np.zeros((len(patch.faces), 3, 2), np.float32)
    under, _ = top_faces(joint, patch.faces, corners, fine)
    image, texels = paint_floor(
        mesh,
        MaterialSampler(materials),
        plan.floor_faces,
        grow(plan.fill | cells_at(outlines, fine) | (under >= 0), 2),
        plan.rooms,
        fine,
        texel_m=config.patch_texel_m,
        max_px=config.max_texture_px,
    )
    return _patched(unpatched, patch, index, image, uv_on(texels, joint[patch.faces][..., :2]))


def _flattened(
    mesh: WorldMesh, scanned: ScannedFloor, *, ignore: Mask, structure: Mask, config: RepairConfig
) -> tuple[WorldMesh, Columns, Evidence, list[Bump]]:
    """Press bumps flat; return the mesh, its samples and facts after that, and the bumps."""
    evidence_of = partial(
        gather_evidence,
        scanned_z_m=scanned.z_m,
        floor_z_m=scanned.floor_z_m,
        ignore=ignore,
        structure=structure,
        bump_width_m=config.bump_width_m,
        bump_height_m=config.bump_height_m + config.bump_tolerance_m,
    )
    columns = sample_columns(mesh.vertices, mesh.faces, scanned.grid)
    evidence = evidence_of(mesh, columns, cover_m=config.bump_height_m)
    everywhere = heights_everywhere(evidence, np.zeros_like(evidence.covered), scanned.grid)
    mesh, bumps = flatten_bumps(mesh, columns, evidence, everywhere, config)
    if bumps:
        columns = sample_columns(mesh.vertices, mesh.faces, scanned.grid)
    return mesh, columns, evidence_of(mesh, columns), bumps


def _patched(
    floor: RepairedFloor, patch: Patch, index: int, image: Image.Image, corner_uv: F32
) -> RepairedFloor:
    """Add the patch of level `index` to a floor, with its picture and texture coordinates."""
    holes, cracks = _assign_areas(patch, floor.holes, floor.fine)
    material = ScanMaterial(f"floor_patch_{index}", (1.0, 1.0, 1.0), image)
    return replace(
        floor,
        mesh=floor.mesh.extended(
            patch.vertices,
            patch.faces,
            corner_uv,
            material=len(floor.materials),
            obj=len(floor.objects),
        ),
        materials=(*floor.materials, material),
        objects=(*floor.objects, ScanObject(f"FloorPatch_{index}", "floor")),
        patch_area_m2=sum(patch.area_m2),
        holes=holes,
        cracks=cracks,
    )


def _assign_areas(
    patch: Patch, holes: list[Hole], fine: GridSpec
) -> tuple[list[Hole], list[Crack]]:
    """Assign patch areas to the holes they close, by cells; pieces that close none are cracks."""
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
        selected = np.unique(nearest[cells][near[cells]])
        if not len(selected):
            cracks.append(Crack(outer, area))
            continue
        size = np.array([holes[k].cells.sum() for k in selected])
        added[selected] += area * size / size.sum()
    return [replace(h, added_m2=float(a)) for h, a in zip(holes, added, strict=True)], cracks
