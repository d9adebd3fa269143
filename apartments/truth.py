"""The true floor, kept beside the scan so that a repair can be measured."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..formats.core.arrays import Array, Mask
from ..formats.scene.grid import GridSpec
from ..geometry.fusion.surface import ScanMesh
from .building.plan import FloorPlan
from .building.shell import wall_frame

CELL_M = 0.02


def true_floor(plan: FloorPlan, cell_m: float = CELL_M) -> tuple[GridSpec, Mask]:
    """Return a grid and the mask (rows, columns) of all floor, also under furniture, not walls."""
    lower, upper = plan.bounds()
    grid = GridSpec.covering(lower - 0.5, upper + 0.5, cell_m)
    rows, columns = np.indices(grid.shape)
    xy = grid.center_of(np.stack([rows, columns], -1))
    mask = np.zeros(grid.shape, dtype=bool)
    for room in plan.rooms:
        mask |= np.all((xy > room.lower_m) & (xy < room.upper_m), axis=-1)
    for door in (o for o in plan.openings if o.kind in ("door", "passage")):
        place = wall_frame(plan.rooms[door.room], door.axis, door.sign)
        p, q = place(door.start_m, -0.01, 0)[:2], place(door.end_m, plan.wall_m, 0)[:2]
        mask |= np.all((xy > np.minimum(p, q)) & (xy < np.maximum(p, q)), axis=-1)
    for void in (b for b in plan.blocks if b.kind == "void"):
        mask &= ~np.all((xy > void.lower_m) & (xy < void.upper_m), axis=-1)
    return grid, mask


def covered_cells(grid: GridSpec, triangles_m: Array) -> Mask:
    """Return (rows, columns) that triangles (F, 3, 2 or 3) cover as seen from above."""
    covered = np.zeros(grid.shape, dtype=bool)
    flat = triangles_m[..., :2]
    longest = np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2).max(1)
    # So many samples along an edge that no covered cell is missed.
    order = np.ceil(np.maximum(longest, 1e-6) / (0.6 * grid.cell_m)).astype(int)
    for n in np.unique(order):
        group = flat[order == n]
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        inside = i + j <= n
        b, c = i[inside] / n, j[inside] / n
        weights = np.stack([1 - b - c, b, c], -1)
        xy = np.einsum("sk,fki->fsi", weights, group).reshape(-1, 2)
        cells = grid.cell_of(xy)
        cells = cells[grid.inside(cells)]
        covered[cells[:, 0], cells[:, 1]] = True
    return covered


def seen_floor(grid: GridSpec, mesh: ScanMesh, floor_z_m: float = 0.0) -> Mask:
    """Return (rows, columns) where the scan has upward triangles within 8 cm of the floor."""
    normals, _ = mesh.normals()
    points = mesh.vertices[mesh.faces]
    use = (np.abs(points[..., 2] - floor_z_m).max(1) < 0.08) & (normals[:, 2] > 0.7)
    return covered_cells(grid, points[use])


def write_truth(
    path: Path, storeys: Sequence[FloorPlan], mesh: ScanMesh, world_to_scan: Array
) -> None:
    """Write `truth.npz`.

    It holds the grid (`origin_xy_m`, `cell_m`, `shape`) and over it `floor_z_m` (NaN off the
    floor), `floor_mask` and `seen_mask`, all in the world frame (z up), and the (4, 4)
    `world_to_scan`, identity unless the scanner was tilted or moved. The names of these arrays for
    a higher storey k end in `_k`.
    """
    arrays: dict[str, Any] = {}
    for k, plan in enumerate(storeys):
        grid, floor = true_floor(plan)
        end = f"_{k}" if k else ""
        arrays[f"origin_xy_m{end}"] = np.asarray(grid.origin_xy_m)
        arrays[f"cell_m{end}"] = np.float64(grid.cell_m)
        arrays[f"shape{end}"] = np.asarray(grid.shape)
        height = np.float32(plan.floor_z_m)
        arrays[f"floor_z_m{end}"] = np.where(floor, height, np.float32(np.nan))
        arrays[f"floor_mask{end}"] = floor
        arrays[f"seen_mask{end}"] = seen_floor(grid, mesh, plan.floor_z_m) & floor
    np.savez_compressed(path, world_to_scan=world_to_scan, **arrays)
