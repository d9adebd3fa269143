"""Two levels, a staircase between them and a robot → one compiled MuJoCo model.

Geoms are laid out as in `level_model`. The upper floor is boxes, because a plane has no end.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from scipy.ndimage import binary_dilation

from ...formats.core.arrays import Array, Mask
from ...formats.scene.bundle import Obstacles, SceneBundle
from ...formats.scene.grid import GridSpec
from ...formats.scene.staircase import Treads
from ...wayfinding.storeys import climbable_staircase
from ..robots import RobotSpec
from .config import LevelModelConfig
from .floor_geom import GROUND_BODY, add_floor, walked_heights
from .joined_floor import JoinedFloor
from .level_model import add_boxes, add_robot, empty_scene, model_key, robot_extent
from .model_cache import cached_model
from .obstacle_boxes import robot_obstacles
from .rectangles import rectangles

log = logging.getLogger(__name__)

# The upper floor's boxes differ from its record by no more than this, which no foot can feel.
FLOOR_ERROR_M = 0.004
FLOOR_THICK_M = 0.1
# Boxes from below that end so little above the upper floor are its slab, rounded to voxels.
SLAB_M = 0.06
_WITHIN_M = 1e-6


def storeys_model(
    bundle: SceneBundle,
    staircase: int,
    robot: RobotSpec,
    config: LevelModelConfig | None = None,
    cache_dir: Path | None = None,
) -> mujoco.MjModel:
    """Return the compiled model of a staircase and the levels it joins, as `level_model`.

    Raises:
        InputError: no such staircase, or nobody can climb it.
        FileFormatError: the scene's files are missing or damaged.
    """
    config = config or LevelModelConfig()
    if cache_dir is None:
        return build_storeys_model(bundle, staircase, robot, config)
    levels = climbable_staircase(bundle, staircase).levels
    sheets = [bundle.stair_folder(staircase), *map(bundle.level_folder, levels)]
    facts = (bundle.scene_id, staircase, levels, bundle.level_floor_z_m)
    path = cache_dir / f"{model_key(__name__, sheets, facts, robot, config)}.mjb"
    return cached_model(path, lambda: build_storeys_model(bundle, staircase, robot, config))


def build_storeys_model(
    bundle: SceneBundle, staircase: int, robot: RobotSpec, config: LevelModelConfig | None = None
) -> mujoco.MjModel:
    """Compile two levels and their staircase with `robot` at the origin of the world.

    Raises:
        InputError: no such staircase, or nobody can climb it.
        FileFormatError: the scene's files are missing or damaged.
    """
    config = config or LevelModelConfig()
    lower, upper = climbable_staircase(bundle, staircase).levels
    floor = JoinedFloor.of(bundle, staircase)
    stairs = _Stairs(floor.stairs.grid, bundle.stair_treads(staircase))
    reach_m, height_m = robot_extent(robot)
    scene = empty_scene(f"{bundle.scene_id}-stairs-{staircase}-{robot.name}")
    maps = [bundle.freemap(k).for_height(config.free_height_m) for k in (lower, upper)]
    kind = add_floor(scene, floor.lower, walked_heights(floor.lower, maps[0]), config)
    ground = scene.body(GROUND_BODY)
    count = _add_upper_floor(ground, floor, stairs, config)
    treads = stairs.treads
    for center, half, yaw in zip(treads.center_m, treads.half_m, treads.yaw_rad, strict=True):
        _add_floor_box(ground, center, half, float(yaw), config)
    maps.append(bundle.stair_freemap(staircase).for_height(config.climb_height_m))
    parts = [
        stairs.cut_out(bundle.obstacles(lower)),
        stairs.cut_out(bundle.obstacles(upper)),
        bundle.stair_obstacles(staircase),
    ]
    for k in (0, 2):
        parts[k] = _under_floor(parts[k], bundle.level_floor_z_m[upper])
    for k, freemap in enumerate(maps):
        highest = float(np.max(freemap.floor_z_m[freemap.traversable], initial=-np.inf))
        top_m = highest + height_m + config.headroom_m
        parts[k] = robot_obstacles(parts[k], freemap, reach_m, top_m)
    center, half = (np.concatenate([getattr(p, n) for p in parts]) for n in ("center_m", "half_m"))
    add_boxes(scene, Obstacles(center, half), config)
    add_robot(scene, robot)
    model = scene.compile()
    log.debug(
        "staircase %d of %s for %s: floor %s and %d boxes, %d treads, %d obstacles",
        staircase,
        bundle.scene_id,
        robot.name,
        kind,
        count,
        len(treads.yaw_rad),
        int(np.count_nonzero(model.geom_bodyid == 0)),
    )
    return model


def _under_floor(boxes: Obstacles, floor_z_m: float) -> Obstacles:
    """Return boxes from below the upper floor without what of them is the floor itself."""
    low, high = (boxes.center_m + side * boxes.half_m for side in (-1, 1))
    slab = (high[:, 2] > floor_z_m - FLOOR_ERROR_M) & (high[:, 2] < floor_z_m + SLAB_M)
    high[slab, 2] = floor_z_m - FLOOR_THICK_M / 2
    here = high[:, 2] > low[:, 2]
    return Obstacles((low + high)[here] / 2, (high - low)[here] / 2)


def _add_floor_box(
    body: mujoco.MjsBody, center: Array, half: Array, yaw_rad: float, config: LevelModelConfig
) -> None:
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=center,
        size=half,
        quat=[np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)],
        friction=[config.friction, 0.02, 0.01],
    )


def _add_upper_floor(
    body: mujoco.MjsBody, floor: JoinedFloor, stairs: "_Stairs", config: LevelModelConfig
) -> int:
    """Add the upper floor, except over the stairs, and return its number of boxes."""
    record, grid = floor.upper.floor, floor.upper.floor.grid
    # The floor's edge over the stairs is the last of their boxes.
    cells = floor.upper.solid & ~stairs.touched_by(grid)
    pieces = rectangles(cells, record.height_m, FLOOR_ERROR_M)
    for low_row, low_column, row, column in pieces.tolist():
        z = record.height_m[low_row:row, low_column:column]
        x, y = grid.center_of([(low_row + row - 1) / 2, (low_column + column - 1) / 2])
        half = np.array([column - low_column, row - low_row, 0.0]) * grid.cell_m / 2
        half[2] = FLOOR_THICK_M / 2
        _add_floor_box(body, np.array([x, y, np.median(z) - half[2]]), half, 0.0, config)
    return len(pieces)


@dataclass(frozen=True)
class _Stairs:
    """The boxes of a staircase, and their plan on the grid of its sheet."""

    grid: GridSpec
    treads: Treads

    def touched_by(self, grid: GridSpec) -> Mask:
        """Return the cells of another grid, (rows, columns), that overlap treads or landings."""
        centers = grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))
        return np.any(self.treads.without_edge.holds(centers, grid.cell_m / 2), axis=0)

    @cached_property
    def _plan(self) -> Mask:
        """(rows, columns) cells of the sheet on which its own obstacles stand, and no others."""
        centers = self.grid.center_of(np.moveaxis(np.indices(self.grid.shape), 0, -1))
        inside = np.any(self.treads.without_edge.holds(centers), axis=0)
        # A scanned first riser is a box of 5 cm to a level, which stands out before and above it.
        return binary_dilation(inside, np.ones((5, 5), dtype=bool))

    def cut_out(self, obstacles: Obstacles) -> Obstacles:
        """Return a level's boxes without what stands where the stairs are."""
        lower = obstacles.center_m - obstacles.half_m
        upper = obstacles.center_m + obstacles.half_m
        pieces = [
            piece
            for low, high in zip(lower, upper, strict=True)
            for piece in self._pieces(low, high)
        ]
        low, high = np.array(pieces).reshape(-1, 2, 3).transpose(1, 0, 2)
        return Obstacles((low + high) / 2, (high - low) / 2)

    def _pieces(self, low: Array, high: Array) -> Iterator[tuple[Array, Array]]:
        """Yield the parts of a box beside the stairs, as corners (3,) and (3,)."""
        grid, side = self.grid, self.grid.cell_m
        # A box that ends on the border of two cells has nothing in the second.
        whole_first = grid.cell_of(low[:2] + _WITHIN_M)
        whole_end = grid.cell_of(high[:2] - _WITHIN_M) + 1
        first, end = np.maximum(whole_first, 0), np.minimum(whole_end, grid.shape)
        if (end <= first).any() or not self._plan[first[0] : end[0], first[1] : end[1]].any():
            yield low, high
            return
        # Cells beyond the sheet's grid are free, and stand for all that lies there.
        first, end = whole_first, whole_end
        rows, columns = np.ogrid[first[0] : end[0], first[1] : end[1]]
        on_grid = (rows >= 0) & (rows < grid.rows) & (columns >= 0) & (columns < grid.columns)
        free = (
            ~on_grid
            | ~self._plan[np.clip(rows, 0, grid.rows - 1), np.clip(columns, 0, grid.columns - 1)]
        )
        origin = np.asarray(grid.origin_xy_m)
        for row, column, end_row, end_column in rectangles(free, free * 1.0, 0.5).tolist():
            corner = np.array([first[1] + column, first[0] + row]) * side + origin
            other = np.array([first[1] + end_column, first[0] + end_row]) * side + origin
            yield (
                np.array([*np.maximum(corner, low[:2]), low[2]]),
                np.array([*np.minimum(other, high[:2]), high[2]]),
            )
