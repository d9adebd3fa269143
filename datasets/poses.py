"""Planar poses from `observation.state`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..formats.frames import quat_to_yaw, wrap_angle


def planar_poses(state: NDArray) -> NDArray[np.float64]:
    """x, y [m] and yaw [rad] (T, 3) in the start frame, from states (T, 13)."""
    return np.column_stack([state[:, :2].astype(np.float64), quat_to_yaw(state[:, 3:7])])


def poses_relative(state: NDArray, frame: int) -> NDArray[np.float32]:
    """Poses (T, 3): x, y [m], yaw [rad] in (−π, π], seen from the pose of `frame`."""
    return relative(planar_poses(state), frame).astype(np.float32)


def relative(poses: NDArray[np.float64], frame: int) -> NDArray[np.float64]:
    """`poses` (T, 3) in the frame of the pose number `frame`."""
    x, y, yaw = poses[frame]
    offset = poses[:, :2] - (x, y)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([offset @ np.array([[c, -s], [s, c]]), wrap_angle(poses[:, 2] - yaw)])
