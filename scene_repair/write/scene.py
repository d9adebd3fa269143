"""Write a repaired scene: every file of the bundle."""

import json
import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.arrays import I32
from ...formats.core.atomic import file_digest, write_json
from ...formats.process.threads import beside
from ...formats.scene import UNSOUND
from ...formats.scene.bundle import (
    Floor,
    LabeledObject,
    Obstacles,
    SceneBundle,
    VisualMesh,
    load_bundle,
    save_bundle,
    save_index,
)
from ...formats.scene.freemap import Freemap
from ...formats.scene.grid import GridSpec
from ..collide.level_collision import LevelCollision
from ..collide.stair_collision import RepairedStaircase
from ..config import RepairConfig
from ..floor.repair_level import RepairedFloor
from ..grid.world_mesh import WorldMesh
from ..labels.files import LabelBox
from ..labels.semantics import labelled_objects
from ..orient.transform import Orientation
from ..paint.materials import MaterialSampler
from ..scan.record import Scan
from ..storeys.slabs import Slab
from ..usd.write_stage import UsdContent, write_usd
from ..verify.scene import RECORD_NAME, verify_scene
from .describe import (
    describe_flight,
    describe_level,
    describe_slab,
    describe_staircase,
    doubts,
    repair_titles,
    slab_doubts,
    stair_doubts,
)
from .pictures import (
    BLUE,
    GREEN,
    GREY,
    RED,
    is_shown,
    mark_holes,
    mark_staircases,
    text_scale,
    view_from_above,
    write_picture,
)
from .textures import write_materials

# The pictures: free space around the floor, and limits of their size.
PICTURE_MARGIN_M = 0.3
PICTURE_PIXELS, MIN_PICTURE_PX = 1_800_000, 900


@dataclass(frozen=True)
class Repaired:
    """The results of a repair.

    Attributes:
        source: the scan's file.
        scan: what it held, in source coordinates, without the parts left out and what was cut out
            of slabs, and with the sheets that were laid.
        orientation: how it lies in the world.
        boxes: labels from beside it.
        original: the scan in the world, with slabs opened over flights.
        floors: the floors of all levels, lowest first.
        levels: their collision.
        probes: what probing them gave.
        visual: the last floor's mesh, with all repairs, as it is written.
        labels: categories that its faces point to.
        staircases: between them.
        slabs: what was opened over flights.
        notes: doubts about the levels.
    """

    source: Path
    scan: Scan
    orientation: Orientation
    boxes: list[LabelBox]
    original: WorldMesh
    floors: list[RepairedFloor]
    levels: list[LevelCollision]
    probes: list[dict[str, Any]]
    visual: VisualMesh
    labels: tuple[str, ...]
    staircases: list[RepairedStaircase]
    slabs: list[Slab]
    notes: list[str]


def write_scene(repaired: Repaired, out_dir: Path, config: RepairConfig) -> SceneBundle:
    """Write the bundle into the existing folder `out_dir` and open it; the index goes last."""
    scene_id = config.scene_id or repaired.source.stem
    draw = partial(
        _write_pictures, repaired, out_dir, scene_id=scene_id, width_px=config.picture_px
    )
    with beside(draw) as pictures:
        bundle = _write_bundle(repaired, out_dir, scene_id, config.max_texture_px)
        pictures()
    return bundle


def _write_bundle(
    repaired: Repaired, out_dir: Path, scene_id: str, max_texture_px: int
) -> SceneBundle:
    """Write all but the pictures, and open it."""
    source, orientation = repaired.source, repaired.orientation
    evidence = orientation.evidence
    materials = write_materials(repaired.floors[-1].materials, out_dir, max_texture_px)
    heights = tuple(floor.floor_z_m for floor in repaired.floors)
    named, visual, index = _named(repaired, heights)
    levels = [_sheet(level, index) for level in repaired.levels]
    staircases = tuple(s.staircase for s in repaired.staircases)
    facts = {
        "path": source.name,
        "sha256": file_digest(source),
        "licence": repaired.scan.licence,
        **evidence,
    }
    write_usd(
        out_dir / "scene.usdc",
        UsdContent(
            visual=visual,
            materials=materials,
            labels=repaired.labels,
            objects=named,
            levels=[(floor, obstacles) for floor, obstacles, _ in levels],
            facts={key: facts[key] for key in ("path", "sha256", "licence")},
        ),
    )
    if repaired.scan.companion is not None:
        facts |= repaired.scan.companion.save(out_dir, orientation.file_to_world)
    record = {
        "scene_id": scene_id,
        "source": facts,
        "triangles_before": len(repaired.original.faces),
        "triangles_after": len(repaired.floors[-1].mesh.faces),
        "warnings": list(repaired.scan.warnings),
        "doubts": [
            *doubts(evidence, repaired.levels, repaired.floors),
            *repaired.notes,
            *stair_doubts(staircases),
            *slab_doubts(repaired.slabs),
        ],
        "levels": [
            describe_level(floor, probes)
            for floor, probes in zip(repaired.floors, repaired.probes, strict=True)
        ],
        "staircases": [describe_staircase(s.staircase, s.flights) for s in repaired.staircases],
        "opened_slabs": [describe_slab(slab) for slab in repaired.slabs],
        "flights": [describe_flight(f) for s in repaired.staircases for f in s.flights],
    }
    # Quickly, without the indents of the last one: for the verification alone.
    (out_dir / RECORD_NAME).write_text(json.dumps(record))
    bundle = SceneBundle(
        root=out_dir,
        scene_id=scene_id,
        source=facts,
        source_to_world=orientation.file_to_world,
        habitat_to_world=orientation.habitat_to_world,
        materials=materials,
        labels=repaired.labels,
        objects=named,
        level_floor_z_m=heights,
        generator=repaired.scan.generator,
        staircases=staircases,
    )
    stairs = {
        k: (*_sheet(s.sheet, index), s.treads)
        for k, s in enumerate(repaired.staircases)
        if s.sheet and s.treads
    }
    save_bundle(bundle, visual, levels, stairs)
    bundle = load_bundle(out_dir)
    # Only what lies on the disk can be verified; the record then says what came out.
    proof = verify_scene(bundle, usd_checked=True)
    write_json(out_dir / RECORD_NAME, {**record, "verification": proof})
    if not proof["sound"]:
        # Datasets made from it must be able to state this.
        bundle = replace(bundle, source={**bundle.source, UNSOUND: proof["problems"]})
        save_index(bundle)
    return bundle


def _named(
    repaired: Repaired, heights_m: tuple[float, ...]
) -> tuple[tuple[LabeledObject, ...], VisualMesh, I32]:
    """Return the named objects, the mesh whose faces point to them, and their index.

    The index (objects of the scan,) is −1 for those without a name.
    """
    named, index = labelled_objects(
        repaired.scan,
        repaired.boxes,
        vertices_world_m=repaired.original.vertices,
        source_to_world=repaired.orientation.source_to_world,
        level_floor_z_m=heights_m,
    )
    own = _object_of(repaired.floors[-1].mesh.face_object, index)
    return named, replace(repaired.visual, face_object=own), index


def _object_of(own: I32, index: I32) -> I32:
    """Return named objects; patches come after the scan's own objects and belong to none."""
    return np.append(index, np.int32(-1))[np.where(own < len(index), own, -1)]


def _sheet(collision: LevelCollision, index: I32) -> tuple[Floor, Obstacles, Freemap]:
    """Return the sheet of a level or staircase, its boxes pointing to named objects."""
    obstacles = collision.obstacles
    named = replace(obstacles, box_object=_object_of(obstacles.box_object, index))
    return collision.floor, named, collision.freemap


def _write_pictures(repaired: Repaired, out_dir: Path, *, scene_id: str, width_px: int) -> None:
    sampler, floors = MaterialSampler(repaired.floors[-1].materials), repaired.floors
    staircases = [s.staircase for s in repaired.staircases]
    fine = floors[0].fine
    cells = np.concatenate([np.argwhere(np.isfinite(f.height_m)) for f in floors])
    low = fine.center_of(cells.min(axis=0)) - PICTURE_MARGIN_M
    size = fine.center_of(cells.max(axis=0)) + PICTURE_MARGIN_M - low
    # Long scenes get a narrower picture instead of an endless one.
    width = min(width_px, math.sqrt(PICTURE_PIXELS * float(size[0] / size[1])))
    width = max(round(width), min(MIN_PICTURE_PX, width_px))
    pixel_m = float(size[0]) / width
    pixels = GridSpec(
        (float(low[0]), float(low[1])), pixel_m, max(round(float(size[1]) / pixel_m), 1), width
    )
    mesh, first = floors[-1].mesh, len(repaired.original.faces)
    views = [
        view_from_above(
            mesh, sampler, f.floor_z_m, pixels, first, level.freemap.traversable_on(pixels)
        )
        for f, level in zip(floors, repaired.levels, strict=True)
    ]
    holes = [hole for f in floors for hole in f.holes]
    filled = sum(hole.fill for hole in holes)
    left_open = any(is_shown(hole) and not hole.fill for hole in holes)
    cracks = sum(len(f.cracks) for f in floors)
    patched_m2 = sum(f.patch_area_m2 for f in floors)
    missing, added = repair_titles(filled, cracks, patched_m2)
    gaps = [("left open", GREY)] if left_open else []
    gaps += [("stairs, up", BLUE)] if repaired.staircases else []
    heads = {
        "before": (f"{scene_id}: as scanned, {missing}", [("hole in the floor", RED), *gaps]),
        "after": (f"{scene_id}: repaired, {added}", [("floor added", GREEN), *gaps]),
    }
    text = min(text_scale(pixels, *head) for head in heads.values())  # they stand side by side
    for k, (name, head) in enumerate(heads.items()):
        marked = {
            f"level {n}, floor at {f.floor_z_m:.2f} m": mark_staircases(
                mark_holes(view[k], f.holes, fine=fine, pixels=pixels, before=k == 0),
                {m: s for m, s in enumerate(staircases) if n in s.levels},
                pixels,
            )
            for n, (view, f) in enumerate(zip(views, floors, strict=True))
        }
        write_picture(out_dir / f"{name}.png", marked, pixels, *head, scale=text)
