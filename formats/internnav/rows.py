"""The rows of one episode of the VLN-PE layout, from a unit's."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..convert.frame_rollout import frame_rollout, frame_view
from ..core.errors import FileFormatError
from ..core.frames import OPTICAL_IN_BODY, matrix_to_quat, quat_multiply, quat_to_yaw
from ..core.rollout import DAGGER
from ..lerobot.statistics import column_statistics
from ..lerobot.units.rows import row_arrays
from ..lerobot.units.unit import EpisodeUnit
from ..rendered.discrete_steps import discrete_steps, planar_poses
from ..rendered.table import planar_motion

# Body axes (x forward, z up) in the optical frame.
_BODY_IN_OPTICAL = matrix_to_quat(OPTICAL_IN_BODY.T)


def chosen_rows(
    unit: EpisodeUnit, every_frame: bool
) -> tuple[NDArray[np.int64], EpisodeUnit, dict[str, NDArray[Any]]]:
    """Choose the rows of an episode: one per discrete step, or, as in DAgger, one per frame.

    Returns:
        Frame numbers of the rows (N,), ascending, possibly repeated; the
        unit as if it had these frames alone; and its columns then.

    Raises:
        FileFormatError: With `every_frame`, if the unit has no discrete actions.
    """
    rows = row_arrays(unit.rows())
    if every_frame or unit.columns["controller"] == DAGGER:
        if "action.discrete" not in rows:
            raise FileFormatError(
                unit.folder,
                f"no action.discrete at {unit.frames_per_second} frames/s; valid: 4 frames/s",
            )
        return np.arange(unit.length), unit, rows
    steps = discrete_steps(planar_poses(rows["observation.state"]))
    count = len(steps.frame)
    rows = {key: values[steps.frame] for key, values in rows.items()}
    state = rows["observation.state"].astype(np.float64)
    index = np.arange(count)
    changed: dict[str, NDArray[Any]] = {
        "action": planar_motion(state[:, :3], state[:, 3:7]),
        "action.discrete": steps.action[:, None],
        "timestamp": index / unit.frames_per_second,
        "frame_index": index,
    }
    rows |= {
        k: v.astype(rows[k].dtype).reshape(rows[k].shape) for k, v in changed.items() if k in rows
    }
    known = {k: column_statistics(v) for k, v in rows.items() if k in unit.statistics}
    stepped = replace(unit, length=count, statistics=unit.statistics | known)
    return steps.frame, stepped, rows | {"action.discrete": changed["action.discrete"]}


def row_columns(
    unit: EpisodeUnit,
    rows: Mapping[str, NDArray[Any]],
    number: int,
    frames: int,
    task: int,
    depth: Path,
) -> dict[str, NDArray[Any]]:
    """Return the columns that the layout's loaders read, LeRobot's, and the unit's own.

    Args:
        unit: As `chosen_rows` returned it.
        number: Index of the episode in its scene.
        frames: Number of rows of the episodes before it.
        task: Index of its first task.
    """
    rollout, view = frame_rollout(unit, rows), frame_view(unit, rows, depth)
    camera = quat_multiply(view.arrays["camera_quat_wxyz"], _BODY_IN_OPTICAL)
    count = unit.length
    index = np.arange(count)
    columns: dict[str, NDArray[Any]] = {
        "observation.camera_position": view.arrays["camera_position_world_m"],
        "observation.camera_orientation": camera,
        "observation.camera_yaw": quat_to_yaw(camera),
        "observation.robot_position": rollout.position_world_m,
        "observation.robot_orientation": rollout.quat_wxyz,
        "observation.robot_yaw": quat_to_yaw(rollout.quat_wxyz),
        "observation.progress": np.ravel(rows["observation.progress"]),
        "observation.step": index,
        "observation.action": np.ravel(rows["action.discrete"]),
        "timestamp": index / unit.frames_per_second,
        "frame_index": index,
        "episode_index": np.full(count, number),
        "index": index + frames,
        "task_index": np.full(count, task),
    }
    # Names that both layouts use hold the same numbers in both.
    return columns | {key: values for key, values in rows.items() if key not in columns}
