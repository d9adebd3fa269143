"""The columns of meta/episodes beyond LeRobot's own."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import pyarrow as pa

from ..core.camera import CameraModel, DepthRange
from ..core.rollout import Metrics, Rollout
from ..core.text_parts import subtasks
from ..rendered.table import FrameTable, StartFrame
from ..vlnce.groups import instruction_ids

_FLOATS = pa.list_(pa.field("element", pa.float64()))
_INTS = pa.list_(pa.field("element", pa.int64()))
_STRINGS = pa.list_(pa.field("element", pa.string()))
_SCALARS = {float: pa.float64(), bool: pa.bool_(), int: pa.int64()}

EPISODE_COLUMNS: dict[str, pa.DataType] = {
    "episode_uid": pa.string(),  # split/scene/id: the same for every robot, controller and view
    "episode_id": pa.string(),
    "trajectory_id": pa.string(),
    "scene_id": pa.string(),
    "level": pa.int64(),  # of the start
    "levels": _INTS,  # of the path, in order
    "staircases": _INTS,  # of the scene that the path takes, in order; none on a single level
    "split": pa.string(),  # as published; the unit's, and the uid, have that of its source
    "instructions": _STRINGS,
    "instruction_episode_ids": _STRINGS,  # the source's episode of each instruction
    "subtasks": _STRINGS,  # parts of the instruction that the robot came to
    "subtask_from_s": _FLOATS,  # since when
    "reference_path_world_m": _FLOATS,  # x, y, z of each point in turn
    "start_position_world_m": _FLOATS,
    "start_yaw_world_rad": pa.float64(),
    "goal_position_world_m": _FLOATS,
    "goal_radius_m": pa.float64(),
    "geodesic_distance_m": pa.float64(),
    "start_frame_origin_world_m": _FLOATS,  # with the yaw: start frame → world
    "start_frame_yaw_world_rad": pa.float64(),
    "robot": pa.string(),
    "controller": pa.string(),
    "light": pa.string(),
    "end_reason": pa.string(),
    "action_discrete_derived": pa.bool_(),
    "camera_name": pa.string(),
    "camera_width_px": pa.int64(),
    "camera_height_px": pa.int64(),
    "camera_hfov_deg": pa.float64(),
    "camera_intrinsics": _FLOATS,  # K row by row
    "depth_near_m": pa.float64(),
    "depth_far_m": pa.float64(),
    **{f"metrics/{f.name}": _SCALARS[f.type] for f in fields(Metrics)},
}

EDITED_ADVICE = (
    "if LeRobot's tools edited a dataset of vlnpe, run "
    "`vlnpe restore <this dataset> --original <the dataset it was made from>`"
)
# Values of columns that older data lacks.
LATER_COLUMNS: dict[str, Any] = {
    "metrics/recovered": False,
    "metrics/down": False,
    "instruction_episode_ids": [],
    "subtasks": [],
    "subtask_from_s": [],
    "levels": [],
    "staircases": [],
}


def episode_columns(
    rollout: Rollout,
    table: FrameTable,
    camera: CameraModel,
    depth_range: DepthRange,
    light: str,
    instructions: Sequence[str],
) -> dict[str, Any]:
    """Return the values of `EPISODE_COLUMNS` for one rollout, as JSON values."""
    episode = rollout.episode
    start = StartFrame.of(rollout)
    ids = instruction_ids(episode)
    parts, from_s = subtasks(rollout, table.sample_index)
    return {
        "episode_uid": f"{episode.split}/{episode.scene_id}/{episode.episode_id}",
        "episode_id": episode.episode_id,
        "trajectory_id": episode.trajectory_id,
        "scene_id": episode.scene_id,
        "level": episode.level,
        "levels": list(episode.levels),
        "staircases": list(episode.staircases),
        "split": episode.split,
        "instructions": list(instructions),
        "instruction_episode_ids": ids if len(ids) == len(instructions) else [],
        "subtasks": parts,
        "subtask_from_s": from_s,
        "reference_path_world_m": episode.reference_path_world_m.ravel().tolist(),
        "start_position_world_m": episode.start_position_world_m.tolist(),
        "start_yaw_world_rad": float(episode.start_yaw_rad),
        "goal_position_world_m": episode.goal_position_world_m.tolist(),
        "goal_radius_m": float(episode.goal_radius_m),
        "geodesic_distance_m": float(episode.geodesic_distance_m),
        "start_frame_origin_world_m": start.origin_world_m.tolist(),
        "start_frame_yaw_world_rad": start.yaw_rad,
        "robot": rollout.robot,
        "controller": rollout.controller,
        "light": light,
        "end_reason": rollout.end_reason.value,
        "action_discrete_derived": table.discrete_derived,
        "camera_name": camera.name,
        "camera_width_px": camera.width_px,
        "camera_height_px": camera.height_px,
        "camera_hfov_deg": float(camera.hfov_deg),
        "camera_intrinsics": camera.intrinsics.ravel().tolist(),
        "depth_near_m": depth_range.near_m,
        "depth_far_m": depth_range.far_m,
        **{f"metrics/{key}": value for key, value in asdict(rollout.metrics).items()},
    }


def camera_of(columns: Mapping[str, Any]) -> CameraModel:
    """Return the camera of a unit's columns."""
    names = ("name", "width_px", "height_px", "hfov_deg")
    return CameraModel(*(columns[f"camera_{name}"] for name in names))
