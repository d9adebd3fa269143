"""NavDP: every frame in LeRobot v2.1's shape, with poses of the camera and a cloud of obstacles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..convert.frame_rollout import start_frame
from ..core.frames import (
    OPTICAL_TO_OPENGL,
    quat_multiply,
    quat_to_yaw,
    transform_points,
    yaw_to_quat,
)
from .lerobot21 import DepthFormat, SceneWriter
from .subset import Layout, Subset, Written
from .walks import Walk, WalkSource

TENTHS = DepthFormat(10_000, 0.1, 5.0, clip=False)  # of a millimetre
SHORTEST = 4  # frames, below which loaders find no goal
OBSTACLE_RGB = (0, 0, 128)  # (0, 0, 0.5), by which loaders tell obstacles
# An obstacle is what the camera sees above the floor up to its own height; in cells of a cloud.
OBSTACLE_FROM_M, CELL_M = 0.1, 0.05
BODY_M = 0.3  # around the base there is the robot itself
_EVERY_PX = 4


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of one scene and level."""
    scene, chunk = SceneWriter(out, TENTHS), "chunk-000"  # loaders read one chunk only
    frames: list[NDArray[np.int64] | None] = []
    cells, images = np.empty((0, 3), np.int64), 0
    for source in sources:
        walk, number = Walk.open(source), len(scene.episodes)
        count = walk.unit.length
        if count < SHORTEST:
            frames.append(None)
            continue
        frames.append(np.arange(count))
        # Loaders sort the names, and take the images of an episode by their place.
        names = [f"episode_{number:06d}_{k:05d}" for k in range(count)]
        poses, floor = walk.camera_poses(), walk.floor_points()
        depths = scene.write_images(walk, np.arange(count), names, chunk)
        rays = walk.camera.pixel_rays()[::_EVERY_PX, ::_EVERY_PX]
        found = [_obstacles(rays, poses[k], floor[k], depth) for k, depth in enumerate(depths)]
        cells = np.unique(np.concatenate([cells, *found]), axis=0)
        columns = {
            "observation.camera_intrinsic": np.tile(walk.camera.intrinsics, (count, 1, 1)),
            "observation.camera_extrinsic": _mounts(walk, poses, floor),
            "action": _opengl(poses),
        }
        span = {"min": images, "max": images + count - 1}
        scene.add(walk, source.texts[0], columns, {"image_index": span}, chunk)
        images += count
    scene.finish()
    if len(cells):
        colours = np.tile(OBSTACLE_RGB, (len(cells), 1))
        cloud = trimesh.PointCloud((cells + 0.5) * CELL_M, colours)
        cloud.export(str(out / "meta" / "pointcloud.ply"))
    facts = (
        f"{images} frames, every frame of the source",
        "depth: uint16 PNG in 0.1 mm, 0 = not measured, beyond 5 m or nearer than 0.1 m",
        "`action`: pose of the camera in the world, x right, y up, z backward, metres",
        "`observation.camera_extrinsic`: the camera over the floor in the robot's frame (x right, "
        "y forward, z up) at each frame; loaders take the first",
        f"`meta/pointcloud.ply`: {len(cells)} cells of {100 * CELL_M:g} cm in which the cameras "
        "saw obstacles; what no walk saw is missing",
    )
    return Written(frames, len(scene.episodes), {}, {}, facts)


def _opengl(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return camera poses (T, 4, 4) with axes x right, y up, z backward."""
    result = poses.copy()
    result[:, :3, :3] = poses[:, :3, :3] @ OPTICAL_TO_OPENGL
    return result


def _mounts(
    walk: Walk, poses: NDArray[np.float64], floor: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the camera (T, 4, 4) in the frame of the robot on the floor, z up, y forward."""
    start = start_frame(walk.unit.columns)
    quat = walk.rows["observation.state"][:, 3:7].astype(np.float64)
    yaw = quat_to_yaw(quat_multiply(yaw_to_quat(start.yaw_rad), quat))
    c, s = np.cos(yaw), np.sin(yaw)
    robot = np.tile(np.eye(4), (len(yaw), 1, 1))
    robot[:, :2, 0] = np.column_stack([s, -c])
    robot[:, :2, 1] = np.column_stack([c, s])
    robot[:, :3, 3] = floor
    return np.linalg.inv(robot) @ _opengl(poses)


def _obstacles(
    rays: NDArray[np.float64],
    pose: NDArray[np.float64],
    floor: NDArray[np.float64],
    depth_m: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return the cells (C, 3) in which a camera sees obstacles."""
    z = depth_m[::_EVERY_PX, ::_EVERY_PX, None]
    points = transform_points(pose, (rays * z)[z[..., 0] > 0])
    height = points[:, 2] - floor[2]
    off = np.hypot(*(points[:, :2] - floor[:2]).T)
    kept = (height >= OBSTACLE_FROM_M) & (height <= pose[2, 3] - floor[2]) & (off > BODY_M)
    return np.unique(np.floor(points[kept] / CELL_M).astype(np.int64), axis=0)


NAVDP = Layout("navdp", "NavDP", write, per_scene=True, depth=True, endings=True)
