"""Proof that the exported triangles carry: probes dropped on every floor cell."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ..formats.freemap import Freemap
from ..formats.grid import GridSpec
from ..formats.scene_bundle import VisualMesh
from .collision import LevelCollision

PROBE_M = 0.02
# A probe starts this far above the floor and must hit by this far below it.
START_M, TOLERANCE_M = 0.15, 0.03


def probe_level(visual: VisualMesh, level: LevelCollision) -> tuple[LevelCollision, dict[str, Any]]:
    """Shoot rays down onto every covered cell, every 2 cm, and compare with the height field.

    Cells through which a probe falls all the same lose their floor in the maps.

    Args:
        visual: the triangles as they are written.
        level: the level's collision.

    Returns:
        The level without the cells that failed, and counts and distances as JSON values.
    """
    floor, grid = level.floor, level.floor.grid
    scene = EmbreeScene()
    TriangleMesh(scene, visual.vertices[visual.faces].astype(np.float32))
    per_side = int(np.ceil(grid.cell_m / PROBE_M - 1e-9))
    probes = GridSpec(
        grid.origin_xy_m, grid.cell_m / per_side, grid.rows * per_side, grid.columns * per_side
    )
    dense = np.repeat(np.repeat(floor.covered, per_side, axis=0), per_side, axis=1)
    index = np.argwhere(dense)
    xy, cell = probes.center_of(index), index // per_side
    expected = floor.height_m[cell[:, 0], cell[:, 1]].astype(np.float64)
    error = _drop(scene, xy, expected + START_M) - expected
    # A ray exactly along a shared edge may slip between both faces; a shifted one must not.
    for shift in (np.array([1e-3, 7e-4]), np.array([-8e-4, 6e-4])):
        again = np.flatnonzero(_fell(error))
        if len(again):
            start = expected[again] + START_M
            error[again] = _drop(scene, xy[again] + shift, start) - expected[again]
    fell = _fell(error)
    failed = np.zeros(grid.shape, dtype=bool)
    failed[cell[fell, 0], cell[fell, 1]] = True
    standing = level.freemap.traversable[cell[:, 0], cell[:, 1]] & ~fell
    deviation = np.abs(error[standing]) * 1000.0
    where = np.argwhere(failed)
    record = {
        "probe_spacing_m": round(probes.cell_m, 5),
        "probes": len(xy),
        "fell_through": int(fell.sum()),
        "cells_left_without_floor": [
            [round(float(v), 3) for v in xy] for xy in grid.center_of(where).reshape(-1, 2)
        ],
        "height_error_mm": {
            f"p{q}": round(float(np.percentile(deviation, q)), 3) for q in (50, 99, 100)
        }
        if len(deviation)
        else {},
    }
    if not failed.any():
        return level, record
    freemap = level.freemap
    kept = LevelCollision(
        replace(floor, covered=floor.covered & ~failed),
        level.obstacles,
        Freemap(
            grid,
            np.where(failed, np.float32(np.nan), freemap.floor_z_m),
            freemap.traversable & ~failed,
        ),
    )
    return kept, record


def _fell(error_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether probes hit nothing, or only something under the floor."""
    return ~(error_m >= -TOLERANCE_M)


def _drop(
    scene: EmbreeScene, xy: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights at which rays down from (xy, z) hit, NaN where they do not."""
    origin = np.column_stack([xy, z]).astype(np.float32)
    down = np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(xy), 1))
    hit = scene.run(origin, down, output=1)
    height = z - hit["tfar"].astype(np.float64)
    return np.where(hit["primID"] >= 0, height, np.nan)
