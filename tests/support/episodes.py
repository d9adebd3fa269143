"""Episodes along given points, for tests that need no sampler."""

import numpy as np
from numpy.typing import ArrayLike

from vlnpe.formats.core.episode import Episode


def episode_along(
    points_xy_m: ArrayLike, name: str = "e0", *, scene: str = "two_rooms", floor_z_m: float = 0.0
) -> Episode:
    """Return an episode whose reference path goes straight from point to point (P, 2) [m].

    It starts at the first point, looks along the path, and has no instruction.
    """
    points = np.asarray(points_xy_m, dtype=np.float64)
    path = np.column_stack([points, np.full(len(points), floor_z_m)])
    ahead = points[1] - points[0]
    return Episode(
        episode_id=name,
        trajectory_id=name,
        scene_id=scene,
        split="train",
        level=0,
        start_position_world_m=path[0],
        start_yaw_rad=float(np.arctan2(ahead[1], ahead[0])),
        goal_position_world_m=path[-1],
        reference_path_world_m=path,
        geodesic_distance_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
    )
