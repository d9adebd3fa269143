"""Synthetic rollouts: a robot that glides along a polyline, for tests that need no physics."""

import numpy as np
from numpy.typing import ArrayLike

from tests.support.episodes import episode_along
from vlnpe.collectors.robots import get_robot
from vlnpe.formats.core.frames import yaw_to_quat
from vlnpe.formats.core.rollout import STATE_RATE_HZ, EndReason, Metrics, Rollout


def glide(points_xy_m: ArrayLike, robot: str = "aliengo", speed_m_s: float = 0.8) -> Rollout:
    """A rollout along straight pieces at constant speed, legs in their default pose."""
    spec = get_robot(robot)
    points = np.asarray(points_xy_m, dtype=np.float64)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = int(length[-1] / speed_m_s * STATE_RATE_HZ) + 1
    time = np.arange(count) / STATE_RATE_HZ
    along = time * speed_m_s
    xy = np.stack([np.interp(along, length, points[:, k]) for k in range(2)], axis=-1)
    piece = np.clip(np.searchsorted(length, along, side="right") - 1, 0, len(points) - 2)
    heading = np.arctan2(*np.diff(points, axis=0)[piece].T[::-1])
    joints = np.tile(spec.default_joint_rad, (count, 1))
    feet = spec.foot_names
    still = np.zeros((count, 3))
    return Rollout(
        episode=episode_along(points, "glide"),
        robot=robot,
        controller="path",
        time_s=time,
        position_world_m=np.column_stack([xy, np.full(count, spec.base_height_m)]),
        quat_wxyz=yaw_to_quat(heading),
        linear_velocity_base_m_s=still,
        angular_velocity_base_rad_s=still,
        joint_names=spec.joint_names,
        joint_position_rad=joints,
        joint_velocity_rad_s=np.zeros_like(joints),
        joint_torque_nm=np.zeros_like(joints),
        command=still,
        foot_names=feet,
        foot_contact=np.ones((count, len(feet)), dtype=bool),
        foot_force_n=np.full((count, len(feet)), 100.0),
        imu=np.zeros((count, 6)),
        floor_z_m=np.zeros(count),
        actions=(),
        events=(),
        end_reason=EndReason.SUCCESS,
        metrics=Metrics(length[-1], 0.0, 0.0, True, True, 1.0, 1.0, False, False, time[-1]),
    )
