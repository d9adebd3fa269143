"""Physics and planning of one level: height field, boxes and freemap from the repaired mesh."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.errors import SceneError
from ...formats.scene.bundle import Floor, Obstacles
from ...formats.scene.freemap import Freemap
from ...formats.scene.grid import GridSpec
from ..config import RepairConfig
from ..floor.repair_level import RepairedFloor
from ..grid.height_field import coarse_floor
from ..grid.morphology import grown_window
from ..grid.world_mesh import WorldMesh
from .boxes import cover_with_boxes
from .free_space import headroom, places, touchable
from .voxels import voxelise

# Kept around the floor: walls, and what leans over them.
MARGIN_M = 0.6
# No side of a box stands out by more than this share of a level's cell before a surface.
SLACK = 0.5


@dataclass(frozen=True)
class LevelCollision:
    """Collision and freemap of one level; boxes belong to the mesh's objects until bundled."""

    floor: Floor
    obstacles: Obstacles
    freemap: Freemap


def level_floor(level: RepairedFloor, grid: GridSpec) -> Floor:
    """Return a level's repaired floor on the cells of `grid`, cropped to its surroundings."""
    return cropped(coarse_floor(level.fine, level.height_m, grid))


def build_collision(
    mesh: WorldMesh, floor: Floor, config: RepairConfig, ground_m: Array | None = None
) -> LevelCollision:
    """Build obstacles and freemap over a floor from the repaired `mesh`.

    Args:
        ground_m: (rows, columns) heights that obstacles rise above; None = the floor's. Where it is
            given, all free floor is a place for robots, however little there is.
    """
    grid = floor.grid
    height = floor.height_m.astype(np.float64)
    ground = height if ground_m is None else ground_m
    low, high = float(height.min()), float(height.max())
    z0 = float(np.floor(low / grid.cell_m) * grid.cell_m)
    layers = int(np.ceil((high - z0 + config.robot_height_m) / grid.cell_m))
    voxels = voxelise(
        mesh.vertices,
        mesh.faces,
        mesh.face_object,
        grid,
        z0_m=z0,
        layers=layers,
        cut_below_m=ground + config.floor_clearance_m,
        cut_above_m=height + config.robot_height_m,
    )
    free_height = headroom(voxels, height, config.blocked_above_m)
    place = floor.covered & np.isinf(free_height)
    if ground_m is None:
        place = places(place, grid.cell_m)
    slack = SLACK * config.cell_m / grid.cell_m
    obstacles = cover_with_boxes(voxels, touchable(voxels, place, height), slack)
    floor_z = np.where(floor.covered, floor.height_m, np.float32(np.nan)).astype(np.float32)
    return LevelCollision(floor, obstacles, Freemap(grid, floor_z, place, free_height))


def cropped(floor: Floor) -> Floor:
    """Crop the floor's grid to the floor and its surroundings."""
    margin = round(MARGIN_M / floor.grid.cell_m)
    rows, columns = np.nonzero(floor.covered)
    if not len(rows):
        raise SceneError(
            f"no floor found: none of its cells of {floor.grid.cell_m} m is covered whole; valid: "
            "connected floor at least as wide as a cell"
        )
    window = grown_window(
        (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)),
        margin,
        floor.grid.shape,
    )
    x, y = floor.grid.origin_xy_m
    cell_m = floor.grid.cell_m
    height, covered = floor.height_m[window], floor.covered[window]
    origin = (x + window[1].start * cell_m, y + window[0].start * cell_m)
    return Floor(GridSpec(origin, cell_m, *height.shape), height, covered)
