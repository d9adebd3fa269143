"""From a rollout and its rendered frames to the per-frame columns of a dataset.

Alignment: what is observed at frame t precedes `action[t]`; the last frame's action is STOP with
zero motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.frames import quat_multiply, quat_to_yaw, wrap_angle, yaw_to_quat
from ..core.rollout import DAGGER, DISCRETE_RATE_HZ, STATE_RATE_HZ, Action, ActionSpan, Rollout
from .discrete_steps import discrete_steps, planar_poses

LABEL = "action.discrete"
EXECUTED = "action.executed"  # the feature that walks of DAgger have beside the expert's labels
_ACTION = "stop_0_forward_1_left_2_right_3"


@dataclass(frozen=True)
class FrameTable:
    """Per-frame columns of one episode.

    Attributes:
        sample_index: (N,) the rollout's sample each frame shows.
        columns: feature name to (N, D) float32, or (N, 1) int64 for discrete actions:
            `observation.state` (13): position [m] in the start frame, quat_wxyz in the start
            frame, linear [m/s] and angular [rad/s] velocity in the base frame;
            `observation.joints` (2 J): positions [rad], then velocities [rad/s];
            `observation.imu` (6): specific force [m/s²] and angular rate [rad/s], base frame;
            `observation.foot_contact` (F): 1 where a foot touches, else 0;
            `observation.foot_force` (F): normal force of the ground on each foot [N];
            `observation.camera_pose` (7): position [m] and quat_wxyz of the optical frame in the
            start frame;
            `observation.progress` (1): frame number over the last frame's, 0 … 1;
            `action` (3): Δx, Δy [m] and Δyaw [rad] to the next frame, in this frame's yaw frame;
            `action.velocity` (3): commanded vx, vy [m/s] and yaw rate [rad/s], base frame;
            `action.discrete` (1): VLN-CE's action at this pose, at 4 frames per second only: the
            executed one, or the one that the expert would take toward the reference path. STOP
            is the last frame's and no other's, except that a walk of DAgger that failed has none;
            `action.executed` (1): in walks of DAgger, whose `action.discrete` is the expert's, the
            action that was executed.
        column_names: what each entry of a column is, with unit and frame.
        discrete_derived: `action.discrete` was not executed, for the controller is continuous: see
            `discrete_steps` for what the robot itself did.
    """

    frames_per_second: int
    sample_index: NDArray[np.int64]
    columns: dict[str, NDArray[np.float32] | NDArray[np.int64]]
    column_names: dict[str, list[str]]
    discrete_derived: bool

    def __len__(self) -> int:
        return len(self.sample_index)


@dataclass(frozen=True)
class StartFrame:
    """Start frame of an episode: the floor under the base at sample 0, gravity up, initial yaw 0.

    Attributes:
        origin_world_m: (3,) [m].
        yaw_rad: world yaw of its x axis.
    """

    origin_world_m: NDArray[np.float64]
    yaw_rad: float

    @staticmethod
    def of(rollout: Rollout) -> "StartFrame":
        """Return the start frame of a rollout."""
        x, y, _ = rollout.position_world_m[0]
        origin = np.array([x, y, rollout.floor_z_m[0]])
        return StartFrame(origin, float(quat_to_yaw(rollout.quat_wxyz[0])))

    def position(self, position_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return world positions (..., 3) [m] in this frame."""
        return _rotate_about_z(position_world_m - self.origin_world_m, -self.yaw_rad)

    def orientation(self, quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return world orientations (N, 4) in this frame, with continuous signs."""
        return _continuous(quat_multiply(yaw_to_quat(-self.yaw_rad), quat_wxyz))


def build_frame_table(
    rollout: Rollout, frames: Mapping[str, NDArray], frames_per_second: int
) -> FrameTable:
    """Sample the rollout at its rendered frames.

    Args:
        frames: `sample_index` (N,), `camera_position_world_m` (N, 3) and `camera_quat_wxyz`
            (N, 4, optical frame), as the render stage stores them.
        frames_per_second: frame rate; divides 100.

    Raises:
        ValueError: the frames are not the rollout's samples at that rate, or a key is missing.
    """
    missing = {"sample_index", "camera_position_world_m", "camera_quat_wxyz"} - set(frames)
    if missing:
        raise ValueError(f"rendered frames lack {sorted(missing)}")
    samples = np.asarray(frames["sample_index"], dtype=np.int64)
    expected = rollout.frame_samples(frames_per_second)
    if len(samples) == 0 or not np.array_equal(samples, expected[: len(samples)]):
        raise ValueError(
            f"{len(samples)} rendered frames are not the rollout's {len(expected)} samples "
            f"at {frames_per_second} frames/s (every {STATE_RATE_HZ // frames_per_second}th)"
        )
    start = StartFrame.of(rollout)
    motion = planar_motion(rollout.position_world_m[samples], rollout.quat_wxyz[samples])
    columns: dict[str, NDArray] = {
        "observation.state": np.concatenate(
            [
                start.position(rollout.position_world_m[samples]),
                start.orientation(rollout.quat_wxyz[samples]),
                rollout.linear_velocity_base_m_s[samples],
                rollout.angular_velocity_base_rad_s[samples],
            ],
            axis=1,
        ),
        "observation.joints": np.concatenate(
            [rollout.joint_position_rad[samples], rollout.joint_velocity_rad_s[samples]], axis=1
        ),
        "observation.imu": rollout.imu[samples],
        "observation.foot_contact": rollout.foot_contact[samples],
        "observation.foot_force": rollout.foot_force_n[samples],
        "observation.camera_pose": np.concatenate(
            [
                start.position(np.asarray(frames["camera_position_world_m"], np.float64)),
                start.orientation(np.asarray(frames["camera_quat_wxyz"], np.float64)),
            ],
            axis=1,
        ),
        "observation.progress": np.linspace(0.0, 1.0, len(samples))[:, None]
        if len(samples) > 1
        else np.ones((1, 1)),
        "action": motion,
        "action.velocity": rollout.command[samples],
    }
    # A body without joints or feet lacks those columns.
    columns = {k: v.astype(np.float32) for k, v in columns.items() if v.shape[1]}
    derived = not rollout.actions
    if frames_per_second == DISCRETE_RATE_HZ:
        poses = planar_poses(columns["observation.state"])
        columns[LABEL] = _discrete_actions(rollout, samples, poses)[:, None]
        if rollout.controller == DAGGER:
            executed = stop_at_end(executed_actions(rollout.actions, samples))
            columns[EXECUTED] = executed[:, None]
    return FrameTable(
        frames_per_second=frames_per_second,
        sample_index=samples,
        columns=columns,
        column_names={
            key: names for key, names in _column_names(rollout).items() if key in columns
        },
        discrete_derived=derived and frames_per_second == DISCRETE_RATE_HZ,
    )


def planar_motion(
    position_world_m: NDArray[np.float64], quat_wxyz: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motion (N, 3) from each pose to the next: Δx, Δy [m] and Δyaw [rad].

    Displacements are in the pose's yaw frame; the last row is zero.
    """
    yaw = quat_to_yaw(quat_wxyz)
    motion = np.zeros((len(yaw), 3))
    motion[:-1, :2] = _rotate_about_z(np.diff(position_world_m, axis=0), -yaw[:-1])[:, :2]
    motion[:-1, 2] = wrap_angle(np.diff(yaw))
    return motion


def executed_actions(
    spans: tuple[ActionSpan, ...], samples: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the discrete action (N,) that is executed from each frame on.

    A frame between two spans (a robot that settles) takes the next span's action; a frame after
    the last one, STOP.
    """
    stops = np.array([span.stop_sample for span in spans], dtype=np.int64)
    actions = np.array([*(int(span.action) for span in spans), int(Action.STOP)], dtype=np.int64)
    return actions[np.searchsorted(stops, samples, side="right")]


def stop_at_end(actions: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return actions (N,) as in VLN-CE: STOP is the last one, and no other.

    A robot that has been stopped, or is near its goal, still moves until it rests. Such a frame
    takes the action before, which the robot executes meanwhile.
    """
    moving = np.where(actions == Action.STOP, -1, np.arange(len(actions)))
    before = np.maximum.accumulate(moving)
    result = np.where(before < 0, int(Action.FORWARD), actions[np.maximum(before, 0)])
    result[-1] = Action.STOP
    return result


def _discrete_actions(
    rollout: Rollout, samples: NDArray[np.int64], poses: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return `action.discrete` (N,) of frames at `DISCRETE_RATE_HZ` with planar poses (N, 3)."""
    if rollout.actions and rollout.labels:
        spans = zip(rollout.actions, rollout.labels, strict=True)
        advised = tuple(replace(span, action=label) for span, label in spans)
        actions = executed_actions(advised, samples)
        if rollout.labels[-1] is Action.STOP:
            return stop_at_end(actions)
        # The expert did not stop where the robot fell or its time was over.
        return np.where(actions == Action.STOP, int(rollout.labels[-1]), actions)
    if rollout.actions:
        return stop_at_end(executed_actions(rollout.actions, samples))
    if rollout.labels:
        return stop_at_end(np.array(rollout.labels, dtype=np.int64)[: len(samples)])
    # A robot's log, or recorded before labels were: what the robot itself did next.
    steps = discrete_steps(poses)
    return stop_at_end(steps.action[np.searchsorted(steps.frame, np.arange(len(samples)))])


def _rotate_about_z(vectors: NDArray[np.float64], angle_rad: NDArray | float) -> NDArray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def _continuous(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Choose signs: w ≥ 0 first, then each nearest to the one before."""
    flips = np.where(np.sum(quat_wxyz[1:] * quat_wxyz[:-1], axis=1) < 0, -1.0, 1.0)
    first = -1.0 if quat_wxyz[0, 0] < 0 else 1.0
    signs = first * np.concatenate([[1.0], np.cumprod(flips)])
    return quat_wxyz * signs[:, None]


def _column_names(rollout: Rollout) -> dict[str, list[str]]:
    quat = [f"quat_{c}_start" for c in "wxyz"]
    return {
        "observation.state": [
            *(f"position_{c}_start_m" for c in "xyz"),
            *quat,
            *(f"linear_velocity_{c}_base_m_s" for c in "xyz"),
            *(f"angular_velocity_{c}_base_rad_s" for c in "xyz"),
        ],
        "observation.joints": [
            *(f"{name}_position_rad" for name in rollout.joint_names),
            *(f"{name}_velocity_rad_s" for name in rollout.joint_names),
        ],
        "observation.imu": [
            *(f"specific_force_{c}_base_m_s2" for c in "xyz"),
            *(f"angular_rate_{c}_base_rad_s" for c in "xyz"),
        ],
        "observation.foot_contact": [f"{name}_contact_0_or_1" for name in rollout.foot_names],
        "observation.foot_force": [f"{name}_force_n" for name in rollout.foot_names],
        "observation.camera_pose": [*(f"position_{c}_start_m" for c in "xyz"), *quat],
        "observation.progress": ["fraction_of_frames"],
        "action": ["delta_x_yaw_frame_m", "delta_y_yaw_frame_m", "delta_yaw_rad"],
        "action.velocity": ["vx_base_m_s", "vy_base_m_s", "yaw_rate_rad_s"],
        LABEL: [_ACTION],
        EXECUTED: [_ACTION],
    }
