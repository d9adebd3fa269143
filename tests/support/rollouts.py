"""Made-up rollouts and rendered frames: kinematically consistent, no physics needed."""

from dataclasses import replace

import numpy as np

from vlnpe.formats.core.episode import Episode
from vlnpe.formats.core.frames import (
    OPTICAL_IN_BODY,
    matrix_to_quat,
    quat_multiply,
    quat_to_matrix,
    yaw_to_quat,
)
from vlnpe.formats.core.rollout import (
    STATE_RATE_HZ,
    Action,
    ActionSpan,
    EndReason,
    Event,
    Metrics,
    Rollout,
)

JOINTS = tuple(f"{leg}_{part}" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh"))


def make_episode(
    number: int = 0, instruction: str = "Walk past the table and stop by the sofa."
) -> Episode:
    """Across the two rooms of `tests.support.scenes.rooms`."""
    path = np.array([[1.0, 2.0, 0.0], [4.0, 2.0, 0.0], [7.0, 2.5 + 0.1 * number, 0.0]])
    return Episode(
        episode_id=f"ep{number}",
        trajectory_id=f"traj{number // 3}",
        scene_id="two_rooms",
        split="train",
        level=0,
        start_position_world_m=path[0],
        start_yaw_rad=0.3,
        goal_position_world_m=path[-1],
        reference_path_world_m=path,
        geodesic_distance_m=6.1,
        instruction=instruction,
        extra={"instructions": [instruction, "Go to the sofa."]},
    )


def make_rollout(
    seconds: float = 3.0, number: int = 0, discrete: bool = False, fall: bool = False
) -> Rollout:
    """A walk that turns, sways and bobs; `number` seeds it."""
    rng = np.random.default_rng(number)
    episode = make_episode(number)
    count = round(seconds * STATE_RATE_HZ) + 1
    time = np.arange(count) / STATE_RATE_HZ
    rate = 0.8 * np.sin(0.9 * time + number)
    yaw = 3.0 + np.concatenate([[0.0], np.cumsum(rate[:-1]) / STATE_RATE_HZ])  # crosses ±π
    speed = 0.6 + 0.2 * np.sin(time)
    velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), np.zeros(count)], -1)
    position = np.array([1.0, 2.0, 0.36]) + np.concatenate(
        [np.zeros((1, 3)), np.cumsum(velocity[:-1], axis=0) / STATE_RATE_HZ]
    )
    position[:, 2] += 0.01 * np.sin(12 * time)
    roll = 0.03 * np.sin(6 * time)
    sway = np.stack([np.cos(roll / 2), np.sin(roll / 2), 0 * roll, 0 * roll], -1)
    joints = len(JOINTS)
    spans = [ActionSpan(Action(1 + k % 3), 25 * k, 25 * (k + 1)) for k in range((count - 1) // 25)]
    if discrete:
        spans.append(ActionSpan(Action.STOP, 25 * len(spans), count))
    end = EndReason.FALL if fall else EndReason.SUCCESS
    return Rollout(
        episode=episode,
        robot="aliengo",
        controller="discrete" if discrete else "path",
        time_s=time,
        position_world_m=position,
        quat_wxyz=quat_multiply(yaw_to_quat(yaw), sway),
        linear_velocity_base_m_s=np.stack([speed, 0 * speed, 0.12 * np.cos(12 * time)], -1),
        angular_velocity_base_rad_s=np.stack([0 * rate, 0 * rate, rate], -1),
        joint_names=JOINTS,
        joint_position_rad=rng.normal(size=(count, joints)),
        joint_velocity_rad_s=rng.normal(size=(count, joints)),
        joint_torque_nm=rng.normal(size=(count, joints)) * 10,
        command=np.stack([speed, 0 * speed, rate], -1),
        foot_names=("FL", "FR", "RL", "RR"),
        foot_contact=rng.random((count, 4)) > 0.5,
        foot_force_n=np.random.default_rng(9).uniform(0.0, 200.0, (count, 4)),
        imu=rng.normal(size=(count, 6)),
        floor_z_m=0.01 * np.sin(position[:, 0]) + 0.002,
        actions=tuple(spans) if discrete else (),
        events=(
            Event(0.5, "contact", "Table_1"),
            Event(float(time[-1]), "fall" if fall else "stop", ""),
        ),
        end_reason=end,
        metrics=Metrics(
            trajectory_length_m=float(np.sum(speed) / STATE_RATE_HZ),
            navigation_error_m=0.2,
            navigation_error_euclidean_m=0.19,
            success=not fall,
            oracle_success=True,
            spl=0.9 * (not fall),
            ndtw=0.95,
            fall=fall,
            stuck=False,
            duration_s=float(time[-1]),
        ),
        facts={"mass_kg": 24.64, "policy": "trot", "seed": number},
    )


def with_body(rollout: Rollout, joints: int, feet: int) -> Rollout:
    """The same walk of another body; the joints' and feet's numbers are made up."""
    rng = np.random.default_rng(joints)
    count = len(rollout.time_s)
    return replace(
        rollout,
        robot=f"body-{joints}-{feet}",
        joint_names=tuple(f"joint_{k:02d}" for k in range(joints)),
        joint_position_rad=rng.normal(size=(count, joints)),
        joint_velocity_rad_s=rng.normal(size=(count, joints)),
        joint_torque_nm=rng.normal(size=(count, joints)),
        foot_names=("left_foot", "right_foot")[:feet],
        foot_contact=rng.random((count, feet)) > 0.5,
        foot_force_n=rng.uniform(0.0, 200.0, (count, feet)),
    )


def make_frames(rollout: Rollout, frames_per_second: int = 4) -> dict[str, np.ndarray]:
    """Return what the render stage stores: a camera 0.3 m ahead of the base, 15° down."""
    samples = rollout.frame_samples(frames_per_second)
    base = quat_to_matrix(rollout.quat_wxyz[samples])
    pitch = np.deg2rad(15.0)
    down = np.array(
        [
            [np.cos(pitch), 0.0, np.sin(pitch)],
            [0.0, 1.0, 0.0],
            [-np.sin(pitch), 0.0, np.cos(pitch)],
        ]
    )
    return {
        "sample_index": samples,
        "time_s": rollout.time_s[samples],
        "camera_position_world_m": rollout.position_world_m[samples]
        + base @ np.array([0.3, 0.0, 0.05]),
        "camera_quat_wxyz": matrix_to_quat(base @ down @ OPTICAL_IN_BODY),
    }


def make_images(
    count: int, number: int = 0, height: int = 64, width: int = 96
) -> tuple[np.ndarray, np.ndarray]:
    """Smooth RGB (N, H, W, 3) uint8 and depth (N, H, W) float32 [m] with an invalid corner."""
    y, x = np.indices((height, width))
    phase = (np.arange(count) * 0.3 + number)[:, None, None]
    rgb = np.stack([np.sin(x / 9 + phase), np.cos(y / 7 + phase), np.sin(x / 11 - phase)], -1)
    depth = 4.0 + 2.0 * np.sin(x / 20 + phase) + y / 40
    depth[:, :6, :6] = 0.0
    return (rgb * 100 + 128).astype(np.uint8), depth.astype(np.float32)
