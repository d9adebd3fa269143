"""The poses that a motion leads through, and the room that a path has: what only tests ask."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vlnpe.formats.core.geometry import resample
from vlnpe.formats.scene.freemap import Freemap


def integrate_motion(motion: NDArray, start_xy_yaw: ArrayLike) -> NDArray[np.float64]:
    """Return poses (N, 3), x, y [m] and unwrapped yaw [rad], that `motion` (N, 3) leads through."""
    poses = [np.asarray(start_xy_yaw, np.float64)]
    for x, y, turn in np.asarray(motion, np.float64)[:-1]:
        c, s = np.cos(poses[-1][2]), np.sin(poses[-1][2])
        poses.append(poses[-1] + (c * x - s * y, s * x + c * y, turn))
    return np.array(poses)


def path_clearance(freemap: Freemap, path_xy_m: ArrayLike) -> NDArray[np.float64]:
    """Return clearances (S,) [m] along a path (P, 2 or 3) [m], sampled every half cell."""
    path = np.asarray(path_xy_m, dtype=np.float64)[:, :2]
    points = resample(path, 0.5 * freemap.grid.cell_m)
    cells = freemap.grid.cell_of(points)
    inside = freemap.grid.inside(cells)
    cells = np.clip(cells, 0, np.array(freemap.grid.shape) - 1)
    clearance = freemap.clearance_m[cells[:, 0], cells[:, 1]]
    return np.where(inside & freemap.traversable[cells[:, 0], cells[:, 1]], clearance, 0.0)
