"""The record of a repair in `repair.json`, and the doubts that are printed."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...formats.core.arrays import Array
from ...formats.scene.staircase import Staircase
from ..collide.level_collision import LevelCollision
from ..floor.outline import cell_polygons
from ..floor.repair_level import RepairedFloor
from ..orient.scale import HIGH_ROOM_M, LOW_ROOM_M, ROOM_M, hall
from ..storeys.flights import Flight
from ..storeys.slabs import Slab
from ..verify.verdict import counted

LEAST_FLOOR_M2 = 4.0  # a scene is rarely made for less
TINY_M2 = 0.005  # less would be shown as 0.00 m²


def describe_level(level: RepairedFloor, probes: dict[str, Any]) -> dict[str, Any]:
    """Return JSON values for one level: areas, every hole, every flattened bump, the probes."""
    scanned = level.scanned_area_m2
    return {
        "floor_z_m": round(level.floor_z_m, 4),
        "floor_area_before_m2": round(scanned, 3),
        "floor_area_after_m2": round(scanned + level.patch_area_m2, 3),
        "patched_area_m2": round(level.patch_area_m2, 4),
        # By cells; what was added is measured on triangles, which reach to the rim and to walls.
        "holes": [
            {
                "polygons_xy_m": [
                    _rounded(p) for p in cell_polygons(hole.cells, level.fine, hole.window)
                ],
                "area_m2": round(hole.area_m2(level.fine), 5),
                "added_m2": round(hole.added_m2, 7),
                "cause": hole.cause,
                "action": "filled" if hole.fill else "left",
                "reason": hole.reason,
            }
            for hole in level.holes
        ],
        "cracks": [
            {
                "polygon_xy_m": _rounded(crack.ring_xy_m),
                "area_m2": round(crack.area_m2, 7),
                "cause": "crack or pinhole finer than the sampling",
                "action": "filled",
            }
            for crack in level.cracks
        ],
        "bumps": [
            {
                "center_xy_m": [round(v, 3) for v in bump.center_xy_m],
                "height_m": round(bump.height_m, 4),
                "width_m": round(bump.width_m, 3),
                "action": "flattened",
            }
            for bump in level.bumps
        ],
        "probes": probes,
    }


def describe_flight(flight: Flight) -> dict[str, Any]:
    """Return JSON values for a flight of stairs; an open sky above it is null."""
    headroom = flight.headroom_m
    return {
        "levels": list(flight.levels),
        "foot_world_m": [round(float(v), 3) for v in flight.foot_world_m],
        "head_world_m": [round(float(v), 3) for v in flight.head_world_m],
        "direction_world_deg": round(flight.direction_world_deg, 1),
        "risers_m": [round(float(v), 4) for v in flight.risers_m],
        "going_m": round(flight.going_m, 3),
        "width_m": round(flight.width_m, 2),
        "headroom_m": round(headroom, 2) if math.isfinite(headroom) else None,
        "problem": flight.problem,
    }


def describe_staircase(staircase: Staircase, flights: Sequence[Flight]) -> dict[str, Any]:
    """Return JSON values for a staircase."""
    return {
        "levels": list(staircase.levels),
        "line_world_m": np.round(staircase.line_world_m, 3).tolist(),
        "flights": len(flights),
        "risers": sum(len(f.risers_m) for f in flights),
        "riser_m": round(staircase.riser_m, 4),
        "going_m": round(staircase.going_m, 3),
        "width_m": round(staircase.width_m, 2),
        "problem": staircase.problem,
    }


def describe_slab(slab: Slab) -> dict[str, Any]:
    """Return JSON values for a slab that was opened over a flight."""
    return {
        "action": "slab opened over flight",
        "levels": list(slab.levels),
        "middle_xy_m": [round(float(v), 3) for v in slab.middle_xy_m],
        "area_m2": round(slab.area_m2, 3),
    }


def slab_doubts(slabs: Sequence[Slab]) -> list[str]:
    """Return one line for each slab that was opened over a flight."""
    return [
        f"slab opened over flight: the stairs from level {slab.levels[0]} to {slab.levels[1]} at "
        "x {:.1f}, y {:.1f} ended under the floor that they lead to, so {:.1f} m² of it and of "
        "the ceiling below were taken out".format(*slab.middle_xy_m, slab.area_m2)
        for slab in slabs
    ]


def stair_doubts(staircases: Sequence[Staircase]) -> list[str]:
    """Return one line for each staircase that nobody can climb."""
    return [
        f"staircase {k} from level {stairs.levels[0]} to {stairs.levels[1]} {stairs.problem}: "
        "no path leads over it"
        for k, stairs in enumerate(staircases)
        if stairs.problem
    ]


def _rounded(polygon_xy_m: Array) -> list[list[float]]:
    return [[round(float(x), 4), round(float(y), 4)] for x, y in polygon_xy_m]


def repair_titles(holes: int, cracks: int, patched_m2: float) -> tuple[str, str]:
    """Return what was missing before a repair, and what it added [m²], for the pictures' titles."""
    counts = f"{counted(holes, 'hole')}, {counted(cracks, 'crack')}"
    if 0 < patched_m2 < TINY_M2:
        return f"{counts}: tiny gaps", "tiny gaps closed"
    area = f"{patched_m2:.2f} m² of floor"
    return f"{counts}, {area} missing", f"{area} added"


def doubts(
    evidence: dict[str, Any], levels: Sequence[LevelCollision], floors: Sequence[RepairedFloor]
) -> list[str]:
    """Return one line for each doubt about up axis, unit (in `evidence`) and floor."""
    lines = list(evidence["doubts"])
    room = evidence["room_height_m"]
    area = sum(float(level.floor.covered.sum()) * level.floor.grid.cell_m**2 for level in levels)
    implausible = []
    usual = LOW_ROOM_M <= room <= HIGH_ROOM_M or hall(room, min(evidence["extent_m"][:2]))
    if room and not usual:
        implausible.append(f"rooms of {room:.2f} m height (usual: {ROOM_M:g} m)")
    if area < LEAST_FLOOR_M2:
        implausible.append(f"{area:.1f} m² of floor")
    if implausible:
        up, unit = evidence["up"], evidence["unit"]
        lines.append(
            f"{' and '.join(implausible)} are implausible with {up} up in {unit}: look at "
            "after.png, and set --up (x y z -x -y -z) or --unit if the scan is turned or scaled "
            "wrongly"
        )
    for k, floor in enumerate(floors):
        scanned = floor.scanned_area_m2
        if floor.patch_area_m2 > scanned:
            lines.append(
                f"level {k}: more floor was added ({floor.patch_area_m2:.1f} m²) than had been "
                f"scanned ({scanned:.1f} m²): look at before.png and after.png, and scan the floor "
                "again if rooms are not what they were"
            )
    return lines
