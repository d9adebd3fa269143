"""Repair one scan, step by step, into a simulation-ready scene."""

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..formats.core.arrays import Mask
from ..formats.core.errors import InputError, SceneError
from ..formats.scene.bundle import SceneBundle, VisualMesh
from ..formats.scene.grid import GridSpec
from .collide.level_collision import build_collision, level_floor
from .collide.stair_collision import build_stairs
from .config import RepairConfig
from .floor.lay import with_ceiling, with_floor
from .floor.repair_level import RepairedFloor, repair_floor
from .grid.columns import sample_columns
from .grid.world_mesh import WorldMesh
from .labels.attach import label_scan
from .labels.semantics import label_by_boxes, not_floor, structural
from .orient.bounds import robust_bounds
from .orient.transform import orient
from .scan.dispatch import read_scan
from .scan.files import licence_beside
from .scan.left_out import advice, without_parts
from .scan.record import Scan, ScanObject
from .storeys.levels import (
    ScannedFloor,
    averted_faces,
    ceilings_in_floors,
    find_levels,
)
from .storeys.slabs import Slab, slabs_over, with_levels_of, with_opened
from .storeys.staircases import ScannedStaircase, find_staircases
from .storeys.surfaces import find_surfaces
from .verify.scene import probe_level
from .verify.verdict import counted
from .write.scene import Repaired, write_scene

log = logging.getLogger(__name__)

# Room around the scan's bounds, so that the outside is connected all around.
MARGIN_M = 0.6
# Floors may lie under low furniture with little air between.
LEAST_CLEARANCE_M = 0.08
# A ceiling in the plane of the floor above is hung this much lower: either could be drawn there.
CEILING_DROP_M = 0.012
# Larger maps take more memory than is reasonable; the sampling gets coarser, then it is refused.
MAX_CELLS = 30_000_000
# Voxels of a level take 10 bytes each; a hilly ground has as many layers as it is high.
MAX_VOXELS = 500_000_000

Reader = Callable[[Path, RepairConfig, Callable[[str], None]], Scan]


def read_surface(source: Path, config: RepairConfig, report: Callable[[str], None]) -> Scan:
    """Read a mesh, USD stage or point cloud, which has a surface of its own; see `read_scan`."""
    report(f"reading {source.name}")
    scan = read_scan(source)
    if config.collision:
        raise InputError(
            f"--collision {config.collision}: {source.name} already has a surface; "
            "valid: Gaussian splats"
        )
    return scan


def repair_scene(
    source: Path,
    out_dir: Path,
    config: RepairConfig | None = None,
    progress: Callable[[str], None] | None = None,
    read: Reader = read_surface,
) -> SceneBundle:
    """Read the scan `source`; write the repaired scene into `out_dir` and return its bundle.

    Args:
        source: a scan; `<stem>.labels.json` and `<stem>.house` beside it are used if there.
        out_dir: an existing, empty folder; the caller makes it atomic.
        config: settings; None = the defaults.
        progress: called with one short line before each step.
        read: reads the source; `splats.repair` reads Gaussian splats.

    Raises:
        FileFormatError: the file or one beside it is missing, damaged or holds no mesh.
        SceneError: it holds a mesh, but no building with a floor.
    """
    config = config or RepairConfig()
    report = progress or log.info
    source = Path(source)
    scan = without_parts(read(source, config, report), config.exclude)
    scan = replace(scan, licence=scan.licence or licence_beside(source))
    scan, boxes = label_scan(source, scan)
    orientation = orient(scan, config)
    scan = label_by_boxes(scan, boxes, orientation.source_to_world)
    report(
        f"up {orientation.evidence['up']} ({orientation.evidence['up_reason']}), "
        f"unit {orientation.evidence['unit']} ({orientation.evidence['unit_reason']})"
    )
    if config.floor_m is not None:
        scan = with_floor(scan, orientation.source_to_world, config.floor_m)
    if config.ceiling_m is not None:
        scan = with_ceiling(scan, orientation.source_to_world, config.ceiling_m)
    original = WorldMesh.of(scan, orientation.source_to_world)
    coarse, fine = _grids(scan, original, config)
    report(f"finding floors among {len(scan.faces):,} triangles")
    storeys = _find_floors(original, fine, not_floor(scan), config)
    slabs = storeys.slabs
    if slabs:
        report(f"opening {counted(len(slabs), 'slab')} over flights of stairs")
        scan = with_opened(scan, orientation.source_to_world, slabs)
        original = WorldMesh.of(scan, orientation.source_to_world)
        before = storeys.floors
        storeys = _find_floors(original, fine, not_floor(scan), config)
        slabs = with_levels_of(slabs, before, storeys.floors)
    _check_voxels(scan, storeys.floors, config)
    ceilings = storeys.ceilings
    clear = original.lowered(ceilings, CEILING_DROP_M) if ceilings.any() else original
    floors = _repair_floors(scan, clear, storeys.floors, storeys.ignore, config, report)
    mesh = floors[-1].mesh
    report("building collision and freemaps")
    levels = [build_collision(mesh, level_floor(floor, coarse), config) for floor in floors]
    staircases = [
        build_stairs(mesh, scanned, levels, floors[0].fine, config)
        for scanned in storeys.staircases
    ]
    visual, labels = _visual(mesh, floors[-1].objects, floors)
    report("probing the floor")
    probed = [probe_level(visual, level) for level in levels]
    report("writing")
    repaired = Repaired(
        source=source,
        scan=scan,
        orientation=orientation,
        boxes=boxes,
        original=original,
        floors=floors,
        levels=[level for level, _ in probed],
        probes=[record for _, record in probed],
        visual=visual,
        labels=labels,
        staircases=staircases,
        slabs=slabs,
        notes=storeys.notes,
    )
    return write_scene(repaired, out_dir, config)


def _grids(scan: Scan, mesh: WorldMesh, config: RepairConfig) -> tuple[GridSpec, GridSpec]:
    """Return coarse and fine grid with a common origin; raise SceneError if they are too large."""
    lower, upper = robust_bounds(mesh.vertices, mesh.faces)
    coarse = GridSpec.covering(lower[:2] - MARGIN_M, upper[:2] + MARGIN_M, config.cell_m)
    cells = coarse.rows * coarse.columns
    if cells > MAX_CELLS:
        raise SceneError(
            f"the scene covers {cells:,} cells of {config.cell_m} m; valid: up to {MAX_CELLS:,} "
            f"({advice(scan)}cut it into parts, or leave some out: --exclude NAME)"
        )
    factor = math.ceil(config.cell_m / config.fine_m - 1e-9)
    while factor > 1 and cells * factor**2 > MAX_CELLS:
        factor -= 1
    fine = GridSpec(
        coarse.origin_xy_m, config.cell_m / factor, coarse.rows * factor, coarse.columns * factor
    )
    return coarse, fine


def _check_voxels(scan: Scan, floors: list[ScannedFloor], config: RepairConfig) -> None:
    """Raise SceneError if a floor spans so much height and area that memory would not do."""
    for floor in floors:
        cells = np.argwhere(np.isfinite(floor.z_m))
        width, depth = np.ptp(cells, axis=0) * floor.grid.cell_m
        height = float(np.nanmax(floor.z_m) - np.nanmin(floor.z_m))
        voxels = width * depth * (height + config.robot_height_m) / config.cell_m**3
        if voxels > MAX_VOXELS:
            raise SceneError(
                f"its floor at {floor.floor_z_m:.2f} m spans {width:.0f} × {depth:.0f} m and "
                f"{height:.1f} m of height: {voxels:,.0f} voxels; valid: up to {MAX_VOXELS:,} "
                f"({advice(scan)}cut it into parts, or leave some out: --exclude NAME)"
            )


@dataclass(frozen=True)
class _Storeys:
    """The floors of all levels, what joins them, doubts, and faces (F,) that are set apart.

    `slabs` are to be opened, whereupon all else is found again; `ignore` are faces that are no
    floor, `ceilings` those that lie in the plane of one.
    """

    floors: list[ScannedFloor]
    staircases: list[ScannedStaircase]
    slabs: list[Slab]
    notes: list[str]
    ignore: Mask
    ceilings: Mask


def _find_floors(mesh: WorldMesh, fine: GridSpec, ignore: Mask, config: RepairConfig) -> _Storeys:
    """Find the floors and the stairs between them; `ignore` (F,) are faces of furniture."""
    columns = sample_columns(mesh.vertices, mesh.faces, fine)
    up = mesh.normals[:, 2]
    surfaces = find_surfaces(columns, up, ignore, LEAST_CLEARANCE_M)
    floors, notes = find_levels(surfaces, columns, mesh, config)
    averted = averted_faces(floors, columns, up)
    no_floor, ceilings = ignore | averted, averted
    if averted.any():
        surfaces = find_surfaces(columns, up, no_floor, LEAST_CLEARANCE_M)
        floors, notes = find_levels(surfaces, columns, mesh, config)
        ceilings = ceilings_in_floors(floors, columns, averted)
    staircases, slabs = [], []
    if len(floors) > 1:
        # What is labelled as stairs is no floor, and treads may be wound otherwise than floors.
        if no_floor.any():
            surfaces = find_surfaces(columns, up, np.zeros_like(no_floor), LEAST_CLEARANCE_M)
        staircases = find_staircases(surfaces, floors)
        slabs = slabs_over(columns, floors, mesh)
    return _Storeys(floors, staircases, slabs, notes, no_floor, ceilings)


def _repair_floors(
    scan: Scan,
    mesh: WorldMesh,
    scanned_floors: list[ScannedFloor],
    ignore: Mask,
    config: RepairConfig,
    report: Callable[[str], None],
) -> list[RepairedFloor]:
    """Repair the floors one after the other; each starts from the mesh of the one before."""
    structure = structural(scan)
    materials, objects = scan.materials, scan.objects
    floors: list[RepairedFloor] = []
    for k, scanned in enumerate(scanned_floors):
        report(f"repairing the floor of level {k}")
        added = np.zeros(len(mesh.faces) - len(ignore), dtype=bool)
        floor = repair_floor(
            mesh,
            materials,
            objects,
            scanned,
            ignore=np.concatenate([ignore, added]),
            structure=np.concatenate([structure, added]),
            index=k,
            config=config,
        )
        mesh, materials, objects = floor.mesh, floor.materials, floor.objects
        floors.append(floor)
    return floors


def _visual(
    mesh: WorldMesh, objects: tuple[ScanObject, ...], floors: list[RepairedFloor]
) -> tuple[VisualMesh, tuple[str, ...]]:
    """Return the mesh as it is written, and the category names that its faces refer to."""
    labels = tuple(sorted({o.category for o in objects if o.category} | {"floor"}))
    number = {name: k for k, name in enumerate(labels)}
    of_object = np.array([number.get(o.category, -1) for o in objects] + [-1])
    face_label = of_object[mesh.face_object]
    for floor in floors:
        bare = floor.scanned_faces[face_label[floor.scanned_faces] < 0]
        face_label[bare] = number["floor"]
    return (
        VisualMesh(
            vertices=mesh.vertices.astype(np.float32),
            faces=mesh.faces.astype(np.int32),
            corner_uv=mesh.corner_uv,
            face_material=mesh.face_material,
            face_label=face_label.astype(np.int32),
        ),
        labels,
    )
