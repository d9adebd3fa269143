"""Physics and planning of one level: height field, boxes and freemap from the repaired mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..formats.freemap import Freemap
from ..formats.grid import GridSpec
from ..formats.scene_bundle import Floor, Obstacles
from .boxes import merge_boxes
from .config import RepairConfig
from .floor_field import coarse_floor
from .freespace import blocked_cells, solid_inside
from .level_floor import RepairedFloor
from .maps import grow
from .voxels import voxelise
from .world_mesh import WorldMesh


@dataclass(frozen=True)
class LevelCollision:
    """What the simulator and the planner get for one level."""

    floor: Floor
    obstacles: Obstacles
    freemap: Freemap
    solid_cells: NDArray[np.bool_]


def build_collision(
    mesh: WorldMesh, level: RepairedFloor, grid: GridSpec, config: RepairConfig
) -> LevelCollision:
    """Build the collision of one level.

    Args:
        mesh: the fully repaired scan.
        level: the level's floor.
        grid: coarse cells, aligned with the level's fine ones.
        config: heights.
    """
    floor = coarse_floor(level.fine, level.height_m, grid)
    height = floor.height_m.astype(np.float64)
    near = grow(floor.covered, round(0.5 / grid.cell_m))
    low, high = float(height[near].min()), float(height[near].max())
    z0 = float(np.floor(low / grid.cell_m) * grid.cell_m)
    layers = int(np.ceil((high - z0 + config.robot_height_m) / grid.cell_m))
    voxels = voxelise(
        mesh.vertices,
        mesh.faces,
        grid,
        z0,
        layers,
        height + config.floor_clearance_m,
        height + config.robot_height_m,
    )
    blocked = blocked_cells(voxels, height, config.blocked_above_m)
    solid = solid_inside(voxels, floor.covered & ~blocked, height)
    solid_cells: NDArray[np.bool_] = np.any(solid, axis=2)
    traversable = floor.covered & ~blocked & ~_inside_solid(solid, height, z0, grid.cell_m)
    floor_z = np.where(floor.covered, floor.height_m, np.float32(np.nan)).astype(np.float32)
    return LevelCollision(
        floor, merge_boxes(voxels, solid), Freemap(grid, floor_z, traversable), solid_cells
    )


def _inside_solid(
    solid: NDArray[np.bool_], height_m: NDArray[np.float64], z0_m: float, cell_m: float
) -> NDArray[np.bool_]:
    """Cells with solid voxels a step above the floor (insides of walls and furniture)."""
    bottom = z0_m + cell_m * np.arange(solid.shape[2])
    return np.any(solid & (bottom >= height_m[..., None] + cell_m), axis=2)
