"""The record of a repair in `repair.json`, and the doubts that are printed."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.grid import GridSpec
from ..collide.level_collision import LevelCollision
from ..floor.holes import Hole
from ..floor.outline import cell_polygons
from ..floor.repair_level import RepairedFloor
from ..orient.scale import ROOM_M
from ..orient.transform import HIGH_ROOM_M, LOW_ROOM_M

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
        "holes": [_describe_hole(hole, level.fine) for hole in level.holes],
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


def _rounded(polygon_xy_m: NDArray[np.float64]) -> list[list[float]]:
    return [[round(float(x), 4), round(float(y), 4)] for x, y in polygon_xy_m]


def _describe_hole(hole: Hole, grid: GridSpec) -> dict[str, Any]:
    return {
        "polygons_xy_m": [
            _rounded(polygon) for polygon in cell_polygons(hole.cells, hole.window, grid)
        ],
        # By cells; what was added is measured on triangles, which reach to the rim and to walls.
        "area_m2": round(hole.area_m2(grid), 5),
        "added_m2": round(hole.added_m2, 7),
        "cause": hole.cause,
        "action": "filled" if hole.fill else "left",
        "reason": hole.reason,
    }


def repair_titles(holes: int, cracks: int, patched_m2: float) -> tuple[str, str]:
    """Return what was missing before a repair, and what it added, for the pictures' titles.

    Args:
        holes: how many were filled.
        cracks: how many were closed.
        patched_m2: area of floor that was added [m²].
    """
    counts = f"{_many(holes, 'hole')}, {_many(cracks, 'crack')}"
    if 0 < patched_m2 < TINY_M2:
        return f"{counts}: tiny gaps", "tiny gaps closed"
    area = f"{patched_m2:.2f} m² of floor"
    return f"{counts}, {area} missing", f"{area} added"


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def doubts(
    evidence: dict[str, Any], levels: Sequence[LevelCollision], floors: Sequence[RepairedFloor]
) -> list[str]:
    """Return one line for each doubt about up axis, unit and floor.

    Args:
        evidence: of the orientation.
    """
    found = list(evidence["doubts"])
    room = evidence["room_height_m"]
    area = sum(float(level.floor.covered.sum()) * level.floor.grid.cell_m**2 for level in levels)
    implausible = []
    if room and not LOW_ROOM_M <= room <= HIGH_ROOM_M:
        implausible.append(f"rooms of {room:.2f} m height (usual: {ROOM_M:g} m)")
    if area < LEAST_FLOOR_M2:
        implausible.append(f"{area:.1f} m² of floor")
    if implausible:
        up, unit = evidence["up"], evidence["unit"]
        found.append(
            f"{' and '.join(implausible)} are implausible with {up} up in {unit}: look at "
            "after.png, and set --up (x y z -x -y -z) or --unit if the scan is turned or scaled "
            "wrongly"
        )
    for k, floor in enumerate(floors):
        scanned = floor.scanned_area_m2
        if floor.patch_area_m2 > scanned:
            found.append(
                f"level {k}: more floor was added ({floor.patch_area_m2:.1f} m²) than had been "
                f"scanned ({scanned:.1f} m²): look at before.png and after.png, and scan the floor "
                "again if rooms are not what they were"
            )
    return found
