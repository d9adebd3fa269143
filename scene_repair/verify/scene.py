"""Verify that the written floor carries: rays onto every cell, and balls dropped in MuJoCo."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import Array, Mask
from ...formats.core.errors import FileFormatError
from ...formats.process.threads import in_order
from ...formats.scene.bundle import Floor, SceneBundle, VisualMesh
from ...formats.scene.freemap import Freemap
from ..collide.level_collision import LevelCollision
from ..grid.morphology import grow, label, windows
from .exported import Surface, usd_surfaces, visual_surface
from .floor_gaps import check_holes
from .floor_steps import MAX_LISTED, find_steps
from .probe_balls import drop_balls
from .probe_rays import START_M, TOLERANCE_M, Probes, shoot_down
from .probe_sky import open_sky_share
from .usd import check_usd
from .verdict import judge_level

RECORD_NAME = "repair.json"
# Balls per level: half on the seams of what was added, half spread over the floor.
MAX_BALLS = 600
# A ball this far under the floor fell through it.
FALLEN_M = 0.05
# Probes listed by position at most.
MAX_PLACES = 100


def probe_level(visual: VisualMesh, level: LevelCollision) -> tuple[LevelCollision, dict[str, Any]]:
    """Shoot rays down onto every covered cell, every 2 cm, and compare with the height field.

    Cells through which a probe still falls lose their floor in the maps: mostly sampled
    cells that reach into walls. Walkable ones among them are reported apart, for they should not.
    The level without them is returned, and counts and distances as JSON values.
    """
    floor, freemap = level.floor, level.freemap
    corners = visual.vertices[visual.faces]
    surface = _near(Surface(corners, np.zeros(len(corners), dtype=bool)), floor)
    probes = shoot_down(surface, floor.grid, floor.height_m)
    fell = probes.fell & probes.spread(floor.covered)
    failed = _cells(fell, probes.per_side)
    lost = failed & freemap.traversable
    standing = probes.spread(freemap.traversable) & ~probes.fell
    deviation = np.abs(probes.height_m - probes.spread(floor.height_m))[standing] * 1000.0
    record = {
        "probe_spacing_m": round(probes.grid.cell_m, 5),
        "probes": int(probes.spread(floor.covered).sum()),
        "fell_through": int(fell.sum()),
        "cells_left_without_floor": [
            [round(float(v), 3) for v in xy] for xy in floor.grid.center_of(np.argwhere(failed))
        ],
        "walkable_cells_lost": int(lost.sum()),
        "walkable_places_lost": _places(lost, floor),
        "open_sky_share": round(open_sky_share(visual, freemap), 3),
        "height_error_mm": {
            f"p{q}": round(float(np.percentile(deviation, q)), 3)
            for q in (50, 99, 100)
            if len(deviation)
        },
    }
    if not failed.any():
        return level, record
    floor_z_m = np.where(failed, np.float32(np.nan), freemap.floor_z_m)
    free = replace(freemap, floor_z_m=floor_z_m, traversable=freemap.traversable & ~failed)
    rest = replace(level, floor=replace(floor, covered=floor.covered & ~failed), freemap=free)
    return rest, record


def _places(cells: Mask, floor: Floor) -> list[dict[str, Any]]:
    """Return connected cells with their centre and area, the largest first."""
    parts, _ = label(cells, diagonal=True)
    places = []
    for number, window in enumerate(windows(parts), start=1):
        selected = np.argwhere(parts[window] == number) + [w.start for w in window]
        xy_m = floor.grid.center_of(selected).mean(axis=0)
        area = round(len(selected) * floor.grid.cell_m**2, 5)
        places.append({"xy_m": [round(float(v), 3) for v in xy_m], "area_m2": area})
    return sorted(places, key=lambda place: -place["area_m2"])[:MAX_PLACES]


def verify_scene(bundle: SceneBundle, usd_checked: bool = False) -> dict[str, Any]:
    """Probe a written scene by the files of its bundle; raise FileFormatError if one is damaged.

    Rays and balls meet the triangles of `visual.npz` and of `scene.usdc` (what is seen, and what
    collides), so that a triangle missing from any of them is found. `repair.json` must account for
    every gap that is left, and every height step over 1.5 cm must be the scan's own.

    Args:
        usd_checked: `check_usd` has just found nothing, so it need not look again.

    Returns:
        JSON values: `sound`, `problems` (one line each, empty if sound), `doubts` (what is too
        small to be a problem), and what was probed per level.
    """
    usd = bundle.root / "scene.usdc"
    if not usd.is_file():
        raise FileFormatError(usd, "missing; the scene's repair is incomplete")
    problems = [f"scene.usdc: {text}" for text in ([] if usd_checked else check_usd(usd))]
    levels, doubts = [], []
    if not problems:
        seen, solid = usd_surfaces(usd)
        surfaces = {
            "visual.npz": visual_surface(bundle),
            "scene.usdc": seen,
            "scene.usdc collision": solid,
        }
        listed = _listed(bundle.root / RECORD_NAME, len(bundle.level_floor_z_m))
        for k, entry in enumerate(listed):
            levels.append(_verify_level(bundle, k, surfaces, entry))
            verdict = judge_level(levels[-1], entry.get("probes", {}))
            problems += [f"level {k}: {text}" for text in verdict.faults]
            doubts += [f"level {k}: {text}" for text in verdict.doubts]
    return {"sound": not problems, "problems": problems, "doubts": doubts, "levels": levels}


def _listed(path: Path, levels: int) -> list[dict[str, Any]]:
    try:
        entries = json.loads(path.read_text())["levels"]
        whole = all(
            {"action", "polygons_xy_m"} <= set(hole) for entry in entries for hole in entry["holes"]
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FileFormatError(path, f"not the record of a repair: {error!r}") from error
    if not whole:
        raise FileFormatError(
            path, "not the record of a repair: a hole lacks its polygon or action"
        )
    if len(entries) != levels:
        raise FileFormatError(path, f"lists {len(entries)} levels; the scene has {levels}")
    return entries


def _verify_level(
    bundle: SceneBundle, index: int, surfaces: dict[str, Surface], listed: dict[str, Any]
) -> dict[str, Any]:
    floor, freemap = bundle.floor(index), bundle.freemap(index)

    def probe(surface: Surface) -> Probes:
        return shoot_down(_near(surface, floor), floor.grid, floor.height_m)

    probed = dict(zip(surfaces, in_order(probe, surfaces.values()), strict=True))
    seen = probed["visual.npz"]
    covered = seen.spread(floor.covered)
    walked = seen.spread(freemap.traversable & floor.covered)
    off_m = np.abs(np.nan_to_num(seen.height_m, nan=np.inf) - seen.spread(floor.height_m))
    on_floor = (off_m <= TOLERANCE_M) & seen.spread(grow(floor.covered))
    start = _ball_places(floor, freemap, seen)
    still_open, unlisted = check_holes(seen, on_floor, listed["holes"])
    unexplained = [
        n
        for n, hole in enumerate(listed["holes"])
        if hole["action"] != "filled" and not hole.get("reason")
    ]
    steps = find_steps(seen, walked)
    solid = ("visual.npz", "scene.usdc collision")
    lost = in_order(lambda name: _balls_lost(surfaces[name], start, floor), solid)
    return {
        "probe_spacing_m": round(seen.grid.cell_m, 5),
        "floor_area_m2": round(float((covered & ~seen.fell).sum()) * seen.grid.cell_m**2, 3),
        "rays": {
            name: _fallen(probes.grid.center_of(np.argwhere(probes.fell & covered)), covered.sum())
            for name, probes in probed.items()
        },
        "balls": {
            name: _fallen(where, len(start)) for name, where in zip(solid, lost, strict=True)
        },
        "steps_over_15_mm": steps[:MAX_LISTED],
        "steps_by_repair": sum(step["origin"] == "repair" for step in steps),
        "steps_in_scan": sum(step["origin"] == "scan" for step in steps),
        "holes_still_open": still_open,
        "holes_unlisted": unlisted,
        "holes_left_without_reason": unexplained,
    }


def _near(surface: Surface, floor: Floor) -> Surface:
    """Return the triangles that a probe may hit."""
    grid = floor.grid
    lower = np.array([*grid.origin_xy_m, float(floor.height_m.min()) - TOLERANCE_M - 0.1])
    size = grid.cell_m * np.array([grid.columns, grid.rows])
    upper = np.array([*(lower[:2] + size), float(floor.height_m.max()) + START_M])
    return surface.between(lower, upper)


def _cells(probes: Mask, per_side: int) -> Mask:
    """Return the floor's cells in which any probe is true."""
    rows, columns = probes.shape
    blocks = probes.reshape(rows // per_side, per_side, columns // per_side, per_side)
    return np.asarray(blocks.any(axis=(1, 3)))


def _ball_places(floor: Floor, freemap: Freemap, probes: Probes) -> Array:
    """Return walkable points (N, 3) to drop balls on: along seams, and spread evenly."""
    free = freemap.traversable & floor.covered
    added = _cells(probes.added, probes.per_side)
    seam = free & added & grow(_cells(~probes.added & ~probes.fell, probes.per_side))
    picked = []
    for cells in (seam, free & ~seam):
        index = np.argwhere(cells)
        count = min(len(index), MAX_BALLS // 2)
        picked.append(index[np.linspace(0, len(index) - 1, count).round().astype(int)])
    index = np.concatenate(picked)
    height = floor.height_m[tuple(index.T)].astype(np.float64)
    return np.column_stack([floor.grid.center_of(index), height])


def _balls_lost(surface: Surface, start_m: Array, floor: Floor) -> Array:
    """Return where balls started that end up below the floor, (N, 2)."""
    end = drop_balls(_near(surface, floor).triangles_m, start_m)
    # Over the edge of a stairwell a ball may roll: what counts is the floor where it is now. Within
    # a cell through which a step's edge passes, that is the lower tread, next to it.
    height = np.where(floor.covered, floor.height_m, np.inf)
    lowest = ndimage.minimum_filter(height, size=3, mode="nearest")
    cell = np.clip(floor.grid.cell_of(end[:, :2]), 0, np.array(floor.grid.shape) - 1)
    lost = (end[:, 2] < lowest[tuple(cell.T)] - FALLEN_M) & floor.covered[tuple(cell.T)]
    return start_m[lost, :2]


def _fallen(where_xy_m: Array, count: int) -> dict[str, Any]:
    return {
        "dropped": int(count),
        "fell_through": len(where_xy_m),
        "where_xy_m": [[round(float(v), 3) for v in xy] for xy in where_xy_m[:MAX_PLACES]],
    }
