"""Rows and index of a unit from others' VLN-PE data, which lacks much of what ours has.

InternData-N1's users miss the camera's intrinsics and find wrong frame rates; what is assumed here
instead is said in the dataset's provenance.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..core.camera import CameraModel, DepthRange
from ..core.errors import InputError
from ..core.frames import (
    OPTICAL_IN_BODY,
    matrix_to_quat,
    quat_multiply,
    quat_to_matrix,
    quat_to_yaw,
)
from ..core.geometry import path_length
from ..core.rollout import DISCRETE_RATE_HZ, EndReason
from ..lerobot.features import dataset_features
from ..lerobot.layout import EPISODE_ROWS
from ..lerobot.statistics import column_statistics
from ..lerobot.units.parts import UnitParts
from ..lerobot.units.rows import unit_rows
from ..rendered.table import FrameTable, StartFrame, planar_motion
from ..video.stream import probe_video
from . import layout
from .reader import LayoutEpisode, SceneFolder

# Height of the base over the floor while standing [m]: VLN-PE's robots.
BASE_HEIGHT_M = {"aliengo": 0.36, "g1": 0.78, "h1": 1.0}
ROBOT_OF_SCAN = {"r2r": "h1", "r2r_flash": "h1", "r2r_aliengo": "aliengo"}
UNKNOWN_ROBOTS = ("", "unknown", "None")
DEPTH_RANGE = DepthRange(0.05, layout.DEPTH_UNIT_M)
# A row is one discrete action, which takes 50 physics steps of 5 ms. The timestamps say i / 6.
ROWS_PER_SECOND = DISCRETE_RATE_HZ
_OPTICAL = matrix_to_quat(OPTICAL_IN_BODY)
_QUAT = [f"quat_{c}_start" for c in "wxyz"]
_NAMES = {
    "observation.state": [
        *(f"position_{c}_start_m" for c in "xyz"),
        *_QUAT,
        *(f"linear_velocity_{c}_base_m_s" for c in "xyz"),
        *(f"angular_velocity_{c}_base_rad_s" for c in "xyz"),
    ],
    "observation.camera_pose": [*(f"position_{c}_start_m" for c in "xyz"), *_QUAT],
    "observation.progress": ["fraction_of_frames"],
    "action": ["delta_x_yaw_frame_m", "delta_y_yaw_frame_m", "delta_yaw_rad"],
    "action.discrete": ["stop_0_forward_1_left_2_right_3"],
}


@dataclass(frozen=True)
class Assumptions:
    """Facts that the layout does not store.

    Attributes:
        robot: whose data it is; None: as info.json or the scan's folder says.
        base_height_m: of the base over the floor; None: known for VLN-PE's robots.
        rgb_codec: for the colour video.
        frames_per_second: rows per second.
    """

    robot: str | None = None
    hfov_deg: float = 90.0
    base_height_m: float | None = None
    split: str = "train"
    rgb_codec: str = "h264"
    frames_per_second: int = ROWS_PER_SECOND

    def note(self) -> dict[str, Any]:
        """Return JSON values for the provenance."""
        return {
            "assumed": dict(vars(self)),
            "derived": [
                "observation.state: velocities, from differences of poses",
                "start frame: the first pose, with the floor base_height_m below it",
                "metrics: from poses and finish status; unknown numbers are NaN",
                "metrics/oracle_success: that of metrics/success; a failed episode may have passed "
                "its goal, which the layout does not store",
            ],
            "missing": ["goal", "reference path", "joints", "IMU", "contacts", "commands"],
        }


def robot_of(scene: SceneFolder, info: dict[str, Any], assumptions: Assumptions) -> str:
    """Return the name of the robot that recorded the data.

    Raises:
        InputError: If neither the options nor the data name the robot.
    """
    named = assumptions.robot or str(info.get("robot_type") or "")
    robot = ROBOT_OF_SCAN.get(scene.scan, "") if named in UNKNOWN_ROBOTS else named
    if not robot:
        raise InputError(f"{scene.folder}: does not name its robot; pass --robot h1, aliengo, …")
    return robot


def foreign_parts(
    scene: SceneFolder,
    number: int,
    episode: LayoutEpisode,
    assumptions: Assumptions,
    rgb_video: Path,
    depth_video: Path,
) -> tuple[UnitParts, pa.Table]:
    """Return the index, without the images' statistics, and rows.

    Raises:
        InputError: If the robot or the height of its base is unknown.
    """
    robot = robot_of(scene, episode.info, assumptions)
    height = assumptions.base_height_m or BASE_HEIGHT_M.get(robot)
    if height is None:
        raise InputError(
            f"{scene.folder}: the height of {robot}'s base is unknown; pass --base-height-m"
        )
    table, start = frame_table(episode, height, assumptions.frames_per_second)
    features = dataset_features(
        table,
        probe_video(rgb_video),
        probe_video(depth_video),
        assumptions.rgb_codec,
        DEPTH_RANGE,
    )
    index = np.arange(len(table))
    rows = table.columns | dict(
        zip(EPISODE_ROWS, (index / table.frames_per_second, index), strict=True)
    )
    rows["timestamp"] = rows["timestamp"].astype(np.float64)
    parts = UnitParts(
        frames_per_second=table.frames_per_second,
        robot=robot,
        features=features,
        task=episode.tasks[0],
        length=len(table),
        statistics={key: column_statistics(values) for key, values in rows.items()},
        columns=_columns(scene, number, episode, assumptions, table, start, robot),
    )
    return parts, unit_rows(rows, features)


def frame_table(
    episode: LayoutEpisode, base_height_m: float, rate: int
) -> tuple[FrameTable, StartFrame]:
    """Return the frame rows of the columns that others' data allows, and the frame they are in."""
    columns = episode.columns
    position = columns["observation.robot_position"]
    quat = _unit(columns["observation.robot_orientation"])
    start = StartFrame(position[0] - [0.0, 0.0, base_height_m], float(quat_to_yaw(quat[0])))
    camera = quat_multiply(_unit(columns["observation.camera_orientation"]), _OPTICAL)
    rotation = quat_to_matrix(quat)
    rows: dict[str, NDArray] = {
        "observation.state": np.concatenate(
            [
                start.position(position),
                start.orientation(quat),
                _linear_velocity(position, rotation, rate),
                _angular_velocity(rotation, rate),
            ],
            axis=1,
        ),
        "observation.camera_pose": np.concatenate(
            [
                start.position(columns["observation.camera_position"]),
                start.orientation(camera),
            ],
            axis=1,
        ),
        "observation.progress": columns["observation.progress"][:, None],
        "action": planar_motion(position, quat),
    }
    rows = {key: values.astype(np.float32) for key, values in rows.items()}
    if rate == DISCRETE_RATE_HZ:
        rows["action.discrete"] = columns["observation.action"][:, None]
    return FrameTable(
        frames_per_second=rate,
        sample_index=np.arange(len(position)),
        columns=rows,
        column_names={key: _NAMES[key] for key in rows},
        discrete_derived=False,
    ), start


def _columns(
    scene: SceneFolder,
    number: int,
    episode: LayoutEpisode,
    assumptions: Assumptions,
    table: FrameTable,
    start: StartFrame,
    robot: str,
) -> dict[str, Any]:
    """Return the episode columns; unknown numbers are NaN."""
    position = episode.columns["observation.robot_position"]
    unknown = float("nan")
    end = _end_reason(episode)
    identity = f"{scene.scan}-{scene.scene}-{number:06d}"
    height, width = episode.rgb.shape[1:3]
    camera = CameraModel("ego", width, height, assumptions.hfov_deg)
    floor = start.origin_world_m.tolist()
    success = end in (EndReason.SUCCESS, EndReason.STOPPED_NEAR)
    return {
        "episode_uid": f"{assumptions.split}/{scene.scene}/{identity}",
        "episode_id": identity,
        "trajectory_id": identity,
        "scene_id": scene.scene,
        "level": 0,
        "split": assumptions.split,
        "instructions": list(episode.tasks),
        "reference_path_world_m": [],
        "start_position_world_m": floor,
        "start_yaw_world_rad": start.yaw_rad,
        "goal_position_world_m": [unknown] * 3,
        "goal_radius_m": 3.0,
        "geodesic_distance_m": unknown,
        "start_frame_origin_world_m": floor,
        "start_frame_yaw_world_rad": start.yaw_rad,
        "robot": robot,
        "controller": "flash" if scene.scan.endswith("flash") else "discrete",
        "light": "unknown",
        "end_reason": end.value,
        "action_discrete_derived": False,
        "camera_name": camera.name,
        "camera_width_px": width,
        "camera_height_px": height,
        "camera_hfov_deg": float(camera.hfov_deg),
        "camera_intrinsics": camera.intrinsics.ravel().tolist(),
        "depth_near_m": DEPTH_RANGE.near_m,
        "depth_far_m": DEPTH_RANGE.far_m,
        "metrics/trajectory_length_m": path_length(position[:, :2]),
        "metrics/navigation_error_m": unknown,
        "metrics/navigation_error_euclidean_m": unknown,
        "metrics/success": success,
        "metrics/oracle_success": success,
        "metrics/spl": unknown,
        "metrics/ndtw": unknown,
        "metrics/fall": end is EndReason.FALL,
        "metrics/recovered": False,
        "metrics/down": end is EndReason.FALL,
        "metrics/stuck": end is EndReason.STUCK,
        "metrics/duration_s": (len(table) - 1) / table.frames_per_second,
    }


def _end_reason(episode: LayoutEpisode) -> EndReason:
    """Return the end reason nearest to how the layout says the episode finished."""
    words = f"{episode.finish_status} {episode.fail_reason}".lower()
    if episode.finish_status == "success":
        return EndReason.SUCCESS
    known = (EndReason.FALL, EndReason.STUCK, EndReason.TIMEOUT, EndReason.STOPPED_NEAR)
    for reason in known:
        if reason.value in words:
            return reason
    return EndReason.STOPPED_FAR


def _unit(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    return quat_wxyz / np.linalg.norm(quat_wxyz, axis=1, keepdims=True)


def _linear_velocity(
    position_world_m: NDArray[np.float64], rotation: NDArray[np.float64], rate: int
) -> NDArray[np.float64]:
    """Return the central differences of positions (N, 3), in the base frame [m/s]."""
    if len(position_world_m) == 1:
        return np.zeros((1, 3))
    velocity = np.gradient(position_world_m, 1.0 / rate, axis=0)
    return np.einsum("nji,nj->ni", rotation, velocity)


def _angular_velocity(rotation: NDArray[np.float64], rate: int) -> NDArray[np.float64]:
    """Return the central differences of orientations (N, 3, 3), in the base frame [rad/s].

    The rotation vector of Rᵀ(t₀) R(t₁) over t₁ − t₀, by way of its quaternion.
    """
    count = len(rotation)
    index = np.arange(count)
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, count - 1)
    turn = matrix_to_quat(np.swapaxes(rotation[before], 1, 2) @ rotation[after])
    axis = turn[:, 1:]
    sine = np.linalg.norm(axis, axis=1)
    angle = 2.0 * np.arctan2(sine, turn[:, 0])
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    duration = np.maximum(after - before, 1) / rate
    return axis * (scale / duration)[:, None]
