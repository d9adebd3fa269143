"""Planar poses relative to each other."""

import numpy as np
from numpy.typing import NDArray

from ..formats.core.frames import wrap_angle
from ..formats.rendered.discrete_steps import planar_poses

__all__ = ["future_poses", "motions", "planar_poses", "relative"]


def relative(poses: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
    """Return `poses` (T, 3) in the frame of the pose number `frame`."""
    x, y, yaw = poses[frame]
    offset = poses[:, :2] - (x, y)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([offset @ np.array([[c, -s], [s, c]]), wrap_angle(poses[:, 2] - yaw)])


def motions(poses: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return Δx, Δy [m], Δyaw [rad] (T, 3) from each pose to the next, in its frame; last zero."""
    return future_poses(poses, 1)[:, 0]


def future_poses(poses: NDArray[np.float64], future: int) -> NDArray[np.float32]:
    """Return the poses (T, F, 3) of the `future` frames after each, seen from it.

    The last is repeated.
    """
    count = len(poses)
    ahead = np.minimum(np.arange(count)[:, None] + np.arange(1, future + 1), count - 1)
    offset = poses[ahead, :2] - poses[:, None, :2]
    c, s = np.cos(poses[:, None, 2]), np.sin(poses[:, None, 2])
    return np.stack(
        [
            c * offset[..., 0] + s * offset[..., 1],
            c * offset[..., 1] - s * offset[..., 0],
            wrap_angle(poses[ahead, 2] - poses[:, None, 2]),
        ],
        axis=-1,
    ).astype(np.float32)
