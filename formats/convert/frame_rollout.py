"""A unit's frame rows as a rollout at frame rate, to be shown where a rollout is.

Not physics truth: single precision, one sample per frame, no torques. The exact rows are stored
apart.
"""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.camera import DepthRange
from ..core.episode import Episode
from ..core.frames import quat_multiply, quat_to_matrix, yaw_to_quat
from ..core.rollout import Action, ActionSpan, EndReason, Metrics, Rollout
from ..lerobot.episode_columns import camera_of
from ..lerobot.layout import RGB_KEY
from ..lerobot.units.unit import EpisodeUnit
from ..rendered.folder import FrameFolder
from ..rendered.table import EXECUTED, StartFrame

Rows = Mapping[str, NDArray[Any]]


def frame_rollout(unit: EpisodeUnit, rows: Rows) -> Rollout:
    """Return the unit's episode as a rollout with one sample per frame; unknown torques are NaN.

    The floor is that at the start; over storeys it is as far below the base as there.

    Raises:
        KeyError, ValueError: a column that every unit has is missing or damaged.
    """
    columns, count = unit.columns, unit.length
    state = rows["observation.state"].astype(np.float64)
    start = start_frame(columns)
    position_m = to_world(start, state[:, :3])
    episode = episode_of(columns, unit.task)
    over_m = position_m[:, 2] - position_m[0, 2] if episode.staircases else np.zeros(count)
    joint_names = _names(unit, "observation.joints", "_position_rad")
    foot_names = _names(unit, "observation.foot_contact", "_contact_0_or_1")
    joints = _column(rows, "observation.joints", count, 2 * len(joint_names))
    position, velocity = np.split(joints, 2, axis=1)
    actions: tuple[ActionSpan, ...] = ()
    labels: tuple[Action, ...] = ()
    if "action.discrete" in rows and not columns["action_discrete_derived"]:
        chosen = np.ravel(rows.get(EXECUTED, rows["action.discrete"])).tolist()
        actions = tuple(ActionSpan(Action(a), i, i + 1) for i, a in enumerate(chosen))
    if EXECUTED in rows:
        labels = tuple(Action(a) for a in np.ravel(rows["action.discrete"]).tolist())
    return Rollout(
        episode=episode,
        robot=unit.robot,
        controller=columns["controller"],
        time_s=np.arange(count) / unit.frames_per_second,
        position_world_m=position_m,
        quat_wxyz=quat_multiply(yaw_to_quat(start.yaw_rad), state[:, 3:7]),
        linear_velocity_base_m_s=state[:, 7:10],
        angular_velocity_base_rad_s=state[:, 10:13],
        joint_names=joint_names,
        joint_position_rad=position,
        joint_velocity_rad_s=velocity,
        joint_torque_nm=np.full_like(position, np.nan),
        command=_column(rows, "action.velocity", count, 3),
        foot_names=foot_names,
        foot_contact=_column(rows, "observation.foot_contact", count, len(foot_names)) > 0.5,
        foot_force_n=_column(rows, "observation.foot_force", count, len(foot_names)),
        imu=_column(rows, "observation.imu", count, 6),
        floor_z_m=start.origin_world_m[2] + over_m,
        actions=actions,
        events=(),
        end_reason=EndReason(columns["end_reason"]),
        metrics=Metrics(**{f.name: columns[f"metrics/{f.name}"] for f in fields(Metrics)}),
        labels=labels,
    )


def frame_view(unit: EpisodeUnit, rows: Rows, depth: Path) -> FrameFolder:
    """Return the unit's videos as rendered frames of `frame_rollout`.

    `depth` is that of its depth.
    """
    columns = unit.columns
    pose = rows["observation.camera_pose"].astype(np.float64)
    start = start_frame(columns)
    camera = camera_of(columns)
    depth_range = DepthRange(columns["depth_near_m"], columns["depth_far_m"])
    codec = unit.features[RGB_KEY]["info"]["video.codec"]
    rgb = unit.video(RGB_KEY)
    facts = {
        "camera": camera.to_json(),
        "depth": {"file": depth.name, "near_m": depth_range.near_m, "far_m": depth_range.far_m},
        "rgb": {"file": rgb.name, "codec": codec},
        "frames_per_second": unit.frames_per_second,
        "frames": unit.length,
        "light": columns["light"],
    }
    return FrameFolder(
        rgb_video=rgb,
        depth_video=depth,
        arrays={
            "sample_index": np.arange(unit.length),
            "camera_position_world_m": to_world(start, pose[:, :3]),
            "camera_quat_wxyz": quat_multiply(yaw_to_quat(start.yaw_rad), pose[:, 3:]),
        },
        camera=camera,
        depth_range=depth_range,
        frames_per_second=unit.frames_per_second,
        light=columns["light"],
        rgb_codec=codec,
        facts=facts,
    )


def episode_of(columns: Mapping[str, Any], task: str) -> Episode:
    """Return the episode described by a unit's columns."""
    over = {key: list(columns[key]) for key in ("staircases", "levels") if columns["staircases"]}
    return Episode(
        episode_id=columns["episode_id"],
        trajectory_id=columns["trajectory_id"],
        scene_id=columns["scene_id"],
        split=columns["split"],
        level=columns["level"],
        start_position_world_m=np.array(columns["start_position_world_m"], np.float64),
        start_yaw_rad=columns["start_yaw_world_rad"],
        goal_position_world_m=np.array(columns["goal_position_world_m"], np.float64),
        reference_path_world_m=np.reshape(
            np.array(columns["reference_path_world_m"], np.float64), (-1, 3)
        ),
        geodesic_distance_m=columns["geodesic_distance_m"],
        instruction=task,
        goal_radius_m=columns["goal_radius_m"],
        extra={"instructions": list(columns["instructions"]), **over},
    )


def start_frame(columns: Mapping[str, Any]) -> StartFrame:
    """Return the frame that the unit's poses are in."""
    origin = np.array(columns["start_frame_origin_world_m"], np.float64)
    return StartFrame(origin, columns["start_frame_yaw_world_rad"])


def to_world(start: StartFrame, position_start_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the positions (N, 3) [m] in the start frame to the world."""
    rotation = quat_to_matrix(yaw_to_quat(start.yaw_rad))
    return position_start_m @ rotation.T + start.origin_world_m


def _names(unit: EpisodeUnit, key: str, suffix: str) -> tuple[str, ...]:
    names = unit.features.get(key, {}).get("names") or []
    return tuple(name.removesuffix(suffix) for name in names if name.endswith(suffix))


def _column(rows: Rows, key: str, count: int, size: int) -> NDArray[np.float64]:
    """Return a column that a body or a source may lack; unknown numbers are NaN."""
    if key not in rows:
        return np.full((count, size), np.nan)
    return np.asarray(rows[key], np.float64).reshape(count, -1)
