"""Proof that the exported triangles carry: probes dropped on every floor cell."""

from __future__ import annotations

from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ..formats.grid import GridSpec
from ..formats.scene_bundle import Floor, VisualMesh

PROBE_M = 0.02
# A probe starts this far above the floor and must hit by this far below it.
START_M, TOLERANCE_M = 0.15, 0.03


def probe_floor(visual: VisualMesh, floor: Floor, skip: NDArray[np.bool_]) -> dict[str, Any]:
    """Shoot rays down onto every covered cell, every 2 cm, and compare with the height field.

    Args:
        visual: the triangles as they are written.
        floor: the level's floor.
        skip: (rows, columns) cells whose floor is under something solid; no foot comes there, but
            they are probed too and counted apart.

    Returns:
        Counts and distances as JSON values.
    """
    scene = EmbreeScene()
    TriangleMesh(scene, visual.vertices[visual.faces].astype(np.float32))
    per_side = int(np.ceil(floor.grid.cell_m / PROBE_M - 1e-9))
    probes = GridSpec(
        floor.grid.origin_xy_m,
        floor.grid.cell_m / per_side,
        floor.grid.rows * per_side,
        floor.grid.columns * per_side,
    )
    dense = np.repeat(np.repeat(floor.covered, per_side, axis=0), per_side, axis=1)
    index = np.argwhere(dense)
    xy = probes.center_of(index)
    cell = index // per_side
    expected = floor.height_m[tuple(cell.T)].astype(np.float64)
    hit = _drop(scene, xy, expected + START_M)
    error = hit - expected
    lost = ~(np.abs(error) <= START_M) | (error < -TOLERANCE_M)
    # A ray exactly along a shared edge may slip between both faces; a shifted one must not.
    again = np.flatnonzero(lost)
    for shift in (np.array([1e-3, 7e-4]), np.array([-8e-4, 6e-4])):
        if len(again):
            retried = _drop(scene, xy[again] + shift, expected[again] + START_M)
            good = np.abs(retried - expected[again]) <= TOLERANCE_M
            error[again[good]] = (retried - expected[again])[good]
            lost[again[good]] = False
            again = again[~good]
    hidden = skip[tuple(cell.T)]
    fallen = lost & ~hidden
    worst = [[round(float(v), 3) for v in p] for p in xy[fallen][:10]]
    clear = ~lost & ~hidden
    return {
        "probe_spacing_m": probes.cell_m,
        "probes": len(xy),
        "fell_through": int(fallen.sum()),
        "fell_through_under_furniture": int((lost & hidden).sum()),
        "first_falls_xy_m": worst,
        "height_error_median_mm": round(1000 * float(np.median(np.abs(error[clear]))), 3)
        if clear.any()
        else None,
        "height_error_p99_mm": round(1000 * float(np.percentile(np.abs(error[clear]), 99)), 3)
        if clear.any()
        else None,
    }


def _drop(
    scene: EmbreeScene, xy: NDArray[np.float64], z: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Heights at which rays down from (xy, z) hit, NaN where they do not."""
    origin = np.column_stack([xy, z]).astype(np.float32)
    down = np.tile(np.array([0.0, 0.0, -1.0], dtype=np.float32), (len(xy), 1))
    hit = scene.run(origin, down, output=1)
    height = z - hit["tfar"].astype(np.float64)
    return np.where(hit["primID"] >= 0, height, np.nan)
