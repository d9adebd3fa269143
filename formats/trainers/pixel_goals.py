"""Which later point of a walk a camera sees, and at which pixel."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..core.camera import CameraModel
from ..core.frames import transform_points

NONE = -1
TOLERANCE_M = 0.25  # of what the pixel shows to the point of the walk
_NEAREST_M = 0.1


def pixel_goals(
    camera: CameraModel,
    camera_poses: NDArray[np.float64],
    floor_world_m: NDArray[np.float64],
    depths_m: Iterable[NDArray[np.float64]],
    farthest_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find for each step the last later step whose place on the floor the camera sees.

    A place is seen if the depth at its pixel, unprojected, lies within `TOLERANCE_M` of it.

    Args:
        camera_poses: (M, 4, 4) in the world, optical axes.
        floor_world_m: (M, 3) place on the floor of each step.
        depths_m: M images (H, W), 0 where nothing was measured.
        farthest_m: Depth from which on it is not used.

    Returns:
        Pixels (M, 2), column and row, and how many steps later (M,); `NONE` where none is seen.
    """
    count, k = len(camera_poses), camera.intrinsics
    pixels = np.full((count, 2), NONE, np.int64)
    ahead = np.full(count, NONE, np.int64)
    for step, depth in enumerate(depths_m):
        later = floor_world_m[step + 1 :]
        if not len(later):
            continue
        seen = transform_points(np.linalg.inv(camera_poses[step]), later)
        front = np.maximum(seen[:, 2:], _NEAREST_M)
        at = np.rint(seen[:, :2] / front * camera.focal_px + k[:2, 2]).astype(np.int64)
        inside = (at >= 0).all(1) & (at < (camera.width_px, camera.height_px)).all(1)
        inside &= seen[:, 2] > _NEAREST_M
        column, row = np.where(inside[:, None], at, 0).T
        z = depth[row, column].astype(np.float64)
        shown = np.column_stack(
            [(np.stack([column, row], 1) - k[:2, 2]) * (z / k[0, 0])[:, None], z]
        )
        off = np.linalg.norm(shown - seen, axis=1)
        visible = np.flatnonzero(inside & (z > 0) & (z < farthest_m) & (off <= TOLERANCE_M))
        if len(visible):
            last = visible[-1]
            pixels[step], ahead[step] = at[last], last + 1
    return pixels, ahead
