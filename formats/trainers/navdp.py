"""NavDP: every frame in LeRobot v2.1's shape, with poses of the camera and a cloud of obstacles."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
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
_PLY = """ply
format binary_little_endian 1.0
element vertex {}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
"""
_BITS = 20  # of a cell's place along an axis: 26 km either way
_HALF = 1 << _BITS - 1


def write(out: Path, sources: Sequence[WalkSource], subset: Subset) -> Written:
    """Write the episodes of one scene and level."""
    scene, chunk = SceneWriter(out, TENTHS), "chunk-000"  # loaders read one chunk only
    frames: list[NDArray[np.int64] | None] = []
    cells, images = np.empty(0, np.int64), 0
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
        cells = np.unique(np.concatenate([cells, *found]))
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
        _write_cloud(out / "meta" / "pointcloud.ply", (_unpacked(cells) + 0.5) * CELL_M)
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
    """Return the cells (C,), as of `_packed`, in which a camera sees obstacles."""
    z = depth_m[::_EVERY_PX, ::_EVERY_PX, None]
    points = transform_points(pose, (rays * z)[z[..., 0] > 0])
    height = points[:, 2] - floor[2]
    off = np.hypot(*(points[:, :2] - floor[:2]).T)
    kept = (height >= OBSTACLE_FROM_M) & (height <= pose[2, 3] - floor[2]) & (off > BODY_M)
    return np.unique(_packed(np.floor(points[kept] / CELL_M).astype(np.int64)))


def _packed(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells (C, 3) as one number each (C,), which sort ten times as fast."""
    x, y, z = (cells + _HALF).T
    return (x << 2 * _BITS) + (y << _BITS) + z


def _unpacked(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    digits = np.stack([cells >> 2 * _BITS, cells >> _BITS, cells], axis=1)
    return (digits & (2 * _HALF - 1)) - _HALF


def _write_cloud(path: Path, points: NDArray[np.floating]) -> None:
    """Write points (N, 3) [m] in the colour of obstacles as PLY."""
    row = np.dtype([("at", "<f4", 3), ("colour", "u1", 3)])
    rows = np.empty(len(points), row)
    rows["at"], rows["colour"] = points, OBSTACLE_RGB
    path.write_bytes(_PLY.format(len(points)).encode() + rows.tobytes())


NAVDP = Layout("navdp", "NavDP", write, per_scene=True, depth=True, endings=True)
