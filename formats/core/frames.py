"""Every conversion between coordinate frames and quaternion orders.

World: right-handed, z up, metres, radians. Quaternions are `quat_wxyz`, unit, w first.
Habitat (VLN-CE): y up, the agent looks along −z at identity, quaternions xyzw.
Cameras: *optical* frame: x right, y down, z forward (OpenCV, ROS and Foxglove).
"""

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array

# Optical axes (x right, y down, z forward) expressed in a body frame (x forward, y left, z up).
OPTICAL_IN_BODY = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
# MuJoCo and OpenGL cameras look along −z with y up.
OPTICAL_TO_OPENGL = np.diag([1.0, -1.0, -1.0])
# Habitat coordinates to a world that was not levelled: (x, y, z) → (x, −z, y).
HABITAT_TO_WORLD = np.array(
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


def transform_points(transform: ArrayLike, points_m: ArrayLike) -> Array:
    """Apply a (4, 4) affine transform to points (..., 3) [m]."""
    matrix = np.asarray(transform, dtype=np.float64)
    return np.asarray(points_m, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def habitat_to_world_position(position_habitat_m: ArrayLike) -> Array:
    """Convert Habitat (x, y up, z) to world (x, −z, y) positions. Shape (..., 3) [m]."""
    p = np.asarray(position_habitat_m, dtype=np.float64)
    return np.stack([p[..., 0], -p[..., 2], p[..., 1]], axis=-1)


def world_to_habitat_position(position_world_m: ArrayLike) -> Array:
    """Convert world (x, y, z up) to Habitat (x, z, −y) positions. Shape (..., 3) [m]."""
    p = np.asarray(position_world_m, dtype=np.float64)
    return np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1)


def habitat_to_world_yaw(rotation_xyzw: ArrayLike) -> float:
    """Return a Habitat agent's heading as world yaw [rad] in (−π, π], 0 = looking along +x.

    Habitat's rotation is about its y axis by θ; its agent looks along −z at θ = 0, which is
    world +y, hence yaw = θ + 90° (the same offset as VLN-PE's public code).
    """
    x, y, z, w = np.asarray(rotation_xyzw, dtype=np.float64)
    # Rotate the agent's forward (0, 0, −1); robust when pitch or roll are not exactly zero.
    forward_habitat = -np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    forward = habitat_to_world_position(forward_habitat)
    return float(np.arctan2(forward[1], forward[0]))


def world_to_habitat_rotation(yaw_rad: float) -> Array:
    """Return the Habitat quaternion (4,), xyzw, of a yaw: inverse of `habitat_to_world_yaw`."""
    half = 0.5 * (yaw_rad - 0.5 * np.pi)
    return np.array([0.0, np.sin(half), 0.0, np.cos(half)])


def xyzw_to_wxyz(quat_xyzw: ArrayLike) -> Array:
    """Move w first; only for a format's edge. Shape (..., 4)."""
    return np.roll(np.asarray(quat_xyzw, dtype=np.float64), 1, axis=-1)


def quat_to_matrix(quat_wxyz: ArrayLike) -> Array:
    """Convert quaternions (..., 4), normalised first, to rotation matrices (..., 3, 3)."""
    q = np.asarray(quat_wxyz, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrix_to_quat(rotation: ArrayLike) -> Array:
    """Convert rotation matrices (..., 3, 3) to unit quaternions (..., 4), wxyz with w ≥ 0.

    Builds the symmetric 4 × 4 matrix whose largest eigenvector is the quaternion (Bar-Itzhack,
    "New method for extracting the quaternion from a rotation matrix", 2000): stable everywhere.
    """
    m = np.asarray(rotation, dtype=np.float64)
    k = np.empty((*m.shape[:-2], 4, 4))
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    vector = np.stack(
        [m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]],
        axis=-1,
    )
    k[..., 0, 0] = trace
    k[..., 0, 1:] = k[..., 1:, 0] = vector
    k[..., 1:, 1:] = m + np.swapaxes(m, -1, -2) - trace[..., None, None] * np.eye(3)
    quat = np.linalg.eigh(k)[1][..., -1]
    return np.where(quat[..., :1] < 0, -quat, quat)


def quat_multiply(a_wxyz: ArrayLike, b_wxyz: ArrayLike) -> Array:
    """Return the Hamilton product a ⊗ b of quaternions (..., 4): rotate by b, then by a."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a_wxyz, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b_wxyz, dtype=np.float64), -1, 0)
    product = [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
    return np.stack(product, axis=-1)


def look_at(position_m: ArrayLike, target_m: ArrayLike) -> Array:
    """Return the optical axes (3, 3), as columns, of a level camera looking at a target (3,) [m].

    Straight up or down, the image's right is x.
    """
    ahead = np.asarray(target_m, dtype=np.float64) - np.asarray(position_m, dtype=np.float64)
    ahead = ahead / np.linalg.norm(ahead)
    across = np.cross(ahead, [0.0, 0.0, 1.0])
    length = np.linalg.norm(across)
    right: Array = across / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([right, np.cross(ahead, right), ahead]).astype(np.float64)


def yaw_to_quat(yaw_rad: ArrayLike) -> Array:
    """Return the rotation about world z by `yaw_rad` (...) as quat_wxyz (..., 4)."""
    half = 0.5 * np.asarray(yaw_rad, dtype=np.float64)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def quat_to_yaw(quat_wxyz: ArrayLike) -> Array:
    """Return the heading of the body x axis about world z [rad], shape (...) from (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz, dtype=np.float64), -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def in_plan_frame(xy_m: ArrayLike, origin_xy_m: ArrayLike, yaw_rad: float) -> Array:
    """Return points (..., 2) [m] ahead and to the left of an origin (2,) [m] with a heading."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return (np.asarray(xy_m) - np.asarray(origin_xy_m)) @ np.array([[c, -s], [s, c]])


def wrap_angle(angle_rad: ArrayLike) -> Array:
    """Wrap angles (...) to [−π, π)."""
    return (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
