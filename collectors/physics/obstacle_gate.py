"""Disable obstacle contacts of the parts of a robot that no obstacle is near to.

In every step MuJoCo walks the tree of all obstacles once for each body of the robot: 23 of 60 µs
for Aliengo among 3,500 boxes, and it mostly finds nothing. The gate takes the obstacles' collision
bit away from each body that is far from all of them, and gives it back before any of its geoms
could arrive. The motion is the same to the last bit, which a test holds.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ...formats.core.arrays import Array, Mask
from ...formats.process.kernel import kernel
from ...formats.scene.grid import GridSpec

OBSTACLE_BIT = 1 << 20  # contype of obstacles, conaffinity of all that may touch them
# No part moves farther between two looks, 20 ms apart: that would be 5 m/s.
MARGIN_M = 0.1
FINER = 2  # distances are kept on a grid so many times finer than the map's


class ObstacleGate:
    """Switches the obstacle bit of each body of one robot.

    Attributes:
        open_bodies: number of bodies for which physics looks for obstacles now.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, base_body: int, map_grid: GridSpec
    ) -> None:
        solid = (model.geom_contype | model.geom_conaffinity) > 0
        of_robot = model.body_rootid[model.geom_bodyid] == model.body_rootid[base_body]
        self._geoms = np.flatnonzero(of_robot & solid)
        self._bodies, self._slot = np.unique(model.geom_bodyid[self._geoms], return_inverse=True)
        self._needed = model.geom_rbound[self._geoms] + MARGIN_M
        self._geom_xpos = data.geom_xpos
        self._contype, self._conaffinity = model.body_contype, model.body_conaffinity
        bits = self._contype[self._bodies], self._conaffinity[self._bodies]
        self._bits = {True: bits, False: tuple(b & ~OBSTACLE_BIT for b in bits)}
        grid = GridSpec(
            map_grid.origin_xy_m,
            map_grid.cell_m / FINER,
            map_grid.rows * FINER,
            map_grid.columns * FINER,
        )
        boxes = np.flatnonzero(model.geom_bodyid == 0)
        self._distance = _distance_m(grid, model, boxes)
        self._frame = np.array([*grid.origin_xy_m, grid.cell_m])
        self._open = np.ones(len(self._bodies), dtype=bool)
        self.open_bodies = len(self._bodies)

    def open(self) -> None:
        """Enable the contacts of every body."""
        self._set(np.ones(len(self._bodies), dtype=bool))

    def update(self) -> None:
        """Update for the present pose; call at least every 20 ms."""
        near = np.zeros(len(self._bodies), dtype=np.bool_)
        _look(
            self._geom_xpos,
            self._geoms,
            self._slot,
            self._needed,
            self._distance,
            self._frame,
            near,
        )
        if (near != self._open).any():
            self._set(near)

    def _set(self, near: Mask) -> None:
        self._open, self.open_bodies = near, int(near.sum())
        for field, k in ((self._contype, 0), (self._conaffinity, 1)):
            field[self._bodies] = np.where(near, self._bits[True][k], self._bits[False][k])


@kernel()
def _look(geom_xpos, geoms, slot, needed, distance, frame, near):
    """Mark in `near` (B,) the bodies with a geom nearer to an obstacle than it needs."""
    rows, columns = distance.shape
    for i in range(len(geoms)):
        column = int(np.floor((geom_xpos[geoms[i], 0] - frame[0]) / frame[2]))
        row = int(np.floor((geom_xpos[geoms[i], 1] - frame[1]) / frame[2]))
        if not (0 <= row < rows and 0 <= column < columns) or distance[row, column] < needed[i]:
            near[slot[i]] = True


def _distance_m(grid: GridSpec, model: mujoco.MjModel, boxes: NDArray[np.intp]) -> Array:
    """Return a lower bound (rows, columns) of the distance of a cell's points to a box [m]."""
    center, half = model.geom_pos[boxes, :2], model.geom_size[boxes, :2]
    last = np.array(grid.shape)
    low = np.clip(grid.cell_of(center - half), 0, last)
    high = np.clip(grid.cell_of(center + half) + 1, 0, last)
    # Corner differences: their double cumulative sum counts the boxes over each cell.
    corners = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.int64)
    np.add.at(corners, (low[:, 0], low[:, 1]), 1)
    np.add.at(corners, (high[:, 0], high[:, 1]), 1)
    np.add.at(corners, (low[:, 0], high[:, 1]), -1)
    np.add.at(corners, (high[:, 0], low[:, 1]), -1)
    occupied = corners.cumsum(0).cumsum(1)[:-1, :-1] > 0
    if not occupied.any():
        return np.full(grid.shape, np.inf)
    # Between cell centres; points of the two cells are nearer by at most a cell's diagonal.
    between = np.asarray(distance_transform_edt(~occupied))
    return np.maximum(between - np.sqrt(2.0), 0.0) * grid.cell_m
