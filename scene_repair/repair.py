"""The repair of one scan, step by step: a scan in, a simulation-ready scene out."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.atomic import write_json
from ..formats.digest import file_digest
from ..formats.errors import FileFormatError
from ..formats.grid import GridSpec
from ..formats.scene_bundle import SceneBundle, VisualMesh, load_bundle, save_bundle
from .collision import LevelCollision, build_collision
from .columns import sample_columns
from .config import RepairConfig
from .describe import describe_level
from .label_files import read_labels
from .level_floor import RepairedFloor, repair_floor
from .levels import averted_faces, find_levels
from .orient import Orientation, orient
from .pictures import GREEN, GREY, RED, mark_holes, view_from_above, write_picture
from .read_mesh import read_mesh
from .scan import Scan, ScanMaterial, ScanObject
from .semantics import label_by_boxes, labelled_objects, not_floor, structural
from .shading import Looks
from .surfaces import find_surfaces
from .textures import write_materials
from .usd_scene import write_usd
from .verify import probe_level
from .world_mesh import WorldMesh

log = logging.getLogger(__name__)

# Room around the scan's bounds, so that the outside is connected all around.
MARGIN_M = 0.6
# Floors may lie under low furniture with little air between.
LEAST_CLEARANCE_M = 0.08
# The pictures: free space around the floor, and limits of their size.
PICTURE_MARGIN_M = 0.3
PICTURE_PIXELS, MIN_PICTURE_PX = 1_800_000, 900
LICENCE_NAMES = ("LICENSE.{stem}", "{stem}.LICENSE", "{stem}.license.txt", "LICENSE")


def repair_scene(
    source: Path,
    out_dir: Path,
    config: RepairConfig | None = None,
    progress: Callable[[str], None] | None = None,
) -> SceneBundle:
    """Read the scan `source` and write the repaired scene into the existing folder `out_dir`.

    Args:
        source: GLB, glTF, OBJ, PLY, STL or OFF; `<stem>.labels.json` beside it is used if there.
        out_dir: an empty folder; the caller makes it atomic.
        config: settings; None = the defaults.
        progress: called with one short line before each step.

    Returns:
        The bundle as it was written.

    Raises:
        FileFormatError: the file is missing, damaged or holds no mesh.
        SceneError: it holds a mesh, but no building with a floor.
    """
    config = config or RepairConfig()
    tell = progress or log.info
    source = Path(source)
    tell(f"reading {source.name}")
    scan = read_mesh(source)
    boxes = read_labels(source)
    way = orient(scan, config)
    scan = label_by_boxes(scan, boxes, way.source_to_world)
    tell(
        f"up {way.evidence['up']} ({way.evidence['up_reason']}), "
        f"unit {way.evidence['unit']} ({way.evidence['unit_reason']})"
    )
    original = WorldMesh.of(scan, way.source_to_world)
    coarse, fine = _grids(original.vertices[original.faces.ravel()], config)
    ignore, structure = not_floor(scan), structural(scan)
    tell(f"finding floors among {len(scan.faces):,} triangles")
    columns = sample_columns(original.vertices, original.faces, fine)
    up = original.normals[:, 2]
    surfaces = find_surfaces(columns, up, ignore, LEAST_CLEARANCE_M)
    found = find_levels(surfaces, columns, original, config)
    averted = averted_faces(found, columns, up)
    if averted.any():
        ignore |= averted
        surfaces = find_surfaces(columns, up, ignore, LEAST_CLEARANCE_M)
        found = find_levels(surfaces, columns, original, config)
    mesh, materials, objects = original, scan.materials, scan.objects
    floors: list[RepairedFloor] = []
    for k, scanned in enumerate(found):
        tell(f"repairing the floor of level {k}")
        added = np.zeros(len(mesh.faces) - len(ignore), dtype=bool)
        floor = repair_floor(
            mesh,
            materials,
            objects,
            scanned,
            np.concatenate([ignore, added]),
            np.concatenate([structure, added]),
            k,
            config,
        )
        mesh, materials, objects = floor.mesh, floor.materials, floor.objects
        floors.append(floor)
    tell("building collision and freemaps")
    levels = [build_collision(mesh, floor, coarse, config) for floor in floors]
    visual, labels = _visual(mesh, objects, floors)
    tell("probing the floor")
    probed = [probe_level(visual, c) for c in levels]
    levels, probes = [level for level, _ in probed], [record for _, record in probed]
    tell("writing")
    return _write(
        source, out_dir, config, scan, way, boxes, original, mesh, materials, floors, levels,
        visual, labels, probes,
    )  # fmt: skip


def _grids(points_m: NDArray[np.float64], config: RepairConfig) -> tuple[GridSpec, GridSpec]:
    """Coarse and fine grid over the scan, with common origin."""
    low, high = points_m.min(axis=0)[:2] - MARGIN_M, points_m.max(axis=0)[:2] + MARGIN_M
    coarse = GridSpec.covering(low, high, config.cell_m)
    factor = math.ceil(config.cell_m / config.fine_m - 1e-9)
    fine = GridSpec(
        coarse.origin_xy_m, config.cell_m / factor, coarse.rows * factor, coarse.columns * factor
    )
    return coarse, fine


def _visual(
    mesh: WorldMesh, objects: tuple[ScanObject, ...], floors: list[RepairedFloor]
) -> tuple[VisualMesh, tuple[str, ...]]:
    """The mesh as it is written, and the category names that its faces point to."""
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


def _write(
    source: Path,
    out_dir: Path,
    config: RepairConfig,
    scan: Scan,
    way: Orientation,
    boxes: list[Any],
    original: WorldMesh,
    mesh: WorldMesh,
    materials: tuple[ScanMaterial, ...],
    floors: list[RepairedFloor],
    levels: list[LevelCollision],
    visual: VisualMesh,
    labels: tuple[str, ...],
    probes: list[dict[str, Any]],
) -> SceneBundle:
    written = write_materials(materials, out_dir, config.max_texture_px)
    heights = tuple(floor.floor_z_m for floor in floors)
    named = labelled_objects(scan, boxes, original.vertices, way.source_to_world, heights)
    scene_id = config.scene_id or source.stem
    usd = [(c.floor, c.obstacles) for c in levels]
    write_usd(out_dir / "scene.usdc", visual, written, labels, named, usd)
    described = [describe_level(f, p) for f, p in zip(floors, probes, strict=True)]
    write_json(
        out_dir / "repair.json",
        {
            "scene_id": scene_id,
            "source": {"name": source.name, **way.evidence},
            "triangles_before": len(original.faces),
            "triangles_after": len(mesh.faces),
            "warnings": list(scan.warnings),
            "levels": described,
        },
    )
    _pictures(out_dir, scene_id, original, mesh, materials, floors, config)
    bundle = SceneBundle(
        root=out_dir,
        scene_id=scene_id,
        source={
            "path": source.name,
            "sha256": file_digest(source),
            "licence": scan.licence or _licence(source),
            **way.evidence,
        },
        source_to_world=way.source_to_world,
        habitat_to_world=way.habitat_to_world,
        materials=written,
        labels=labels,
        objects=named,
        level_floor_z_m=heights,
        generator=scan.generator,
    )
    save_bundle(bundle, visual, [(c.floor, c.obstacles, c.freemap) for c in levels])
    return load_bundle(out_dir)


def _pictures(
    out_dir: Path,
    scene_id: str,
    original: WorldMesh,
    mesh: WorldMesh,
    materials: tuple[ScanMaterial, ...],
    floors: list[RepairedFloor],
    config: RepairConfig,
) -> None:
    looks = Looks(materials)
    fine = floors[0].fine
    known = np.concatenate([np.argwhere(np.isfinite(f.height_m)) for f in floors])
    low = fine.center_of(known.min(axis=0)) - PICTURE_MARGIN_M
    size = fine.center_of(known.max(axis=0)) + PICTURE_MARGIN_M - low
    # Long scenes get a narrower picture instead of an endless one.
    width = min(config.picture_px, math.sqrt(PICTURE_PIXELS * float(size[0] / size[1])))
    width = max(round(width), MIN_PICTURE_PX)
    pixel_m = float(size[0]) / width
    pixels = GridSpec(
        (float(low[0]), float(low[1])), pixel_m, max(round(float(size[1]) / pixel_m), 1), width
    )
    views = [view_from_above(mesh, looks, f.floor_z_m, pixels, len(original.faces)) for f in floors]
    filled = sum(h.fill for f in floors for h in f.holes)
    area = sum(h.area_m2(f.fine) for f in floors for h in f.holes if h.fill)
    added = sum(f.patch_area_m2 for f in floors)
    captions = (
        ("before", f"as scanned, {filled} holes, {area:.2f} m2 of floor missing"),
        ("after", f"repaired, {added:.2f} m2 of floor added"),
    )
    legends = ([("hole in the floor", RED)], [("floor added", GREEN)])
    for k, ((name, caption), legend) in enumerate(zip(captions, legends, strict=True)):
        marked = [
            mark_holes(view[k], f.holes, fine, pixels, before=k == 0)
            for view, f in zip(views, floors, strict=True)
        ]
        write_picture(
            marked,
            pixels,
            f"{scene_id}: {caption}",
            [*legend, ("left open", GREY)],
            out_dir / f"{name}.png",
        )


def _licence(source: Path) -> str:
    """Text of the licence file beside the source, empty if there is none."""
    for name in LICENCE_NAMES:
        path = source.with_name(name.format(stem=source.stem))
        if path.is_file():
            try:
                return path.read_text()
            except UnicodeDecodeError as error:
                raise FileFormatError(path, "licence is not text in UTF-8") from error
    return ""
