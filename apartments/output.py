"""The parts that all generators share: their beginning, and the files beside a capture."""

import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..formats.core.arrays import Array
from ..formats.core.frames import transform_points, world_to_habitat_position
from .building.build import build_scene
from .building.true_scene import TrueScene
from .config import ApartmentConfig

LICENCE = "Apache-2.0"
Progress = Callable[[str], None]
_log = logging.getLogger(__name__)


def begin(
    seed: int, config: ApartmentConfig, progress: Progress | None = None
) -> tuple[np.random.Generator, TrueScene, Progress]:
    """Build the scene of `seed`.

    Returns:
        The random state after it, the scene, and what to call with the name of each further step.
    """
    report = progress or _log.info
    rng = np.random.default_rng(seed)
    report(f"building the {config.kind}")
    return rng, build_scene(rng, config), report


def scan_pose(config: ApartmentConfig) -> Array:
    """Return (4, 4) from world to the scanner's (z up) frame; identity by default."""
    c, s = np.cos(np.deg2rad(config.scan_tilt_deg)), np.sin(np.deg2rad(config.scan_tilt_deg))
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    pose[:3, 3] = -pose[:3, :3] @ np.asarray(config.scan_offset_m)
    return pose


def to_source(points_m: Array, pose: Array) -> Array:
    """Convert world points (..., 3) [m] to the file's coordinates, y up, of a scanner's pose."""
    return world_to_habitat_position(transform_points(pose, points_m))


def write_labels(path: Path, scene: TrueScene, pose: Array) -> None:
    """Write the bounds of every object and room, in the coordinates of the scan.

    Args:
        pose: (4, 4) from world to the scanner's frame; see `scan_pose`.
    """
    boxes = [(o.name, o.category, o.lower_m, o.upper_m) for o in scene.objects]
    counts: dict[str, int] = {}
    for plan in scene.storeys:
        for room in plan.rooms:
            stem = "Room_" + room.kind.replace("'", "").replace(" ", "_")
            counts[stem] = counts.get(stem, 0) + 1
            low = (*room.lower_m, plan.floor_z_m)
            high = (*room.upper_m, plan.floor_z_m + plan.ceiling_m)
            boxes.append((f"{stem}_{counts[stem]}", f"room:{room.kind}", low, high))
    objects = []
    for name, category, low, high in boxes:
        ends = np.array([low, high])
        box = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
        corners = to_source(box, pose)
        lower, upper = (np.round(end, 4).tolist() for end in (corners.min(0), corners.max(0)))
        objects.append({"name": name, "category": category, "lower": lower, "upper": upper})
    content = {"frame": "source", "objects": objects}
    path.write_text(json.dumps(content, indent=1) + "\n")
