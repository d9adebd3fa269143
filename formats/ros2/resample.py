"""A robot's log as episodes at a dataset's rate: where they begin and end, and their rollouts."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..core.episode import Episode
from ..core.errors import FileFormatError
from ..core.frames import matrix_to_quat, quat_to_matrix
from ..core.geometry import path_length
from ..core.rollout import STATE_RATE_HZ, EndReason, Metrics, Rollout
from .clocks import Track
from .topic_map import TopicMap
from .tracks import Tracks

UNKNOWN = float("nan")
# Of a base over level ground, from standing to walking: medians of 1 s differ by at most 2.5 cm in
# gaits of vlnpe, while a base bobs by up to 4 cm.
_BOB_S, _SWAY_M = 1.0, 0.03


# A base that moves farther and faster than this between two messages was carried off by its
# odometry, not by its legs.
_LEAP_M, _LEAP_M_S = 0.5, 5.0


@dataclass(frozen=True)
class Span:
    """Seconds since the bag's start with all that an episode needs, and under one instruction."""

    start_s: float
    stop_s: float
    instruction: str = ""


def needed(path: Path, tracks: Tracks, topics: TopicMap) -> dict[str, Track]:
    """Return what must go on during an episode, by its name: all that the log has and resamples.

    Raises:
        FileFormatError: If no transforms lead from the base to the camera.
    """
    parts = {"odometry": tracks.odometry, "colour": tracks.color, "depth": tracks.depth}
    parts |= {"joint states": tracks.joints, "imu": tracks.imu}
    moving = {
        f"transform to {frame}": tracks.frames[frame][1]
        for frame in _mount(path, tracks, topics)
        if len(tracks.frames[frame][1].time_s) > 1
    }
    return {name: part for name, part in parts.items() if part is not None} | moving


def spans(path: Path, tracks: Tracks, topics: TopicMap) -> list[Span]:
    """Return where a log has all that an episode needs, in order; a new instruction begins one.

    Raises:
        FileFormatError: If no transforms lead from the base to the camera, or there is no such
            span; the reason names the longest gaps.
    """
    parts = needed(path, tracks, topics)
    start = max(part.time_s[0] for part in parts.values())
    stop = min(part.time_s[-1] for part in parts.values())
    holes = [
        (float(a), float(b))
        for part in parts.values()
        for a, b in zip(part.time_s[:-1], part.time_s[1:], strict=True)
        if b - a > topics.max_gap_s
    ]
    holes += _leaps(tracks.odometry)
    holes += [(at, at) for at, _ in tracks.instructions[1:]]
    result = []
    for a, b in [*sorted(holes), (stop, stop)]:
        end = min(a, stop)
        if end - start >= topics.min_episode_s:
            said = [text for at, text in tracks.instructions if at < end]
            result.append(Span(float(start), float(end), said[-1] if said else ""))
        start = max(start, b)
    if not result:
        lacks = f"no {topics.min_episode_s:g} s without a gap over {topics.max_gap_s:g} s"
        has = "; ".join(_extent(name, part) for name, part in parts.items())
        raise FileFormatError(path, f"{lacks} in all that it has: {has}")
    return result


def _extent(name: str, part: Track) -> str:
    times = part.time_s
    gap = f" with gaps up to {np.diff(times).max():.2f} s" if len(times) > 1 else ""
    return f"{name} {times[0]:.1f}–{times[-1]:.1f} s{gap}"


def _leaps(odometry: Track) -> list[tuple[float, float]]:
    """Return where the base is at another place from one message to the next."""
    moved_m = np.linalg.norm(np.diff(odometry.values[:, :3], axis=0), axis=1)
    passed_s = np.diff(odometry.time_s)
    leaps = np.flatnonzero((moved_m > _LEAP_M) & (moved_m > _LEAP_M_S * passed_s))
    return [(float(odometry.time_s[i]), float(odometry.time_s[i + 1])) for i in leaps]


def image_times_ns(
    tracks: Tracks, images: Track, times_s: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return log time, and stamp less that, (N, 2) [ns] of the image nearest to each time."""
    after = np.clip(np.searchsorted(images.time_s, times_s), 1, max(len(images.time_s) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(images.time_s) - 1)
    closer = times_s - images.time_s[before] <= images.time_s[after] - times_s
    nearest = images.values[np.where(closer, before, after)].astype(np.int64)
    return nearest + np.array([tracks.start_ns, 0])


def frame_times(span: Span, rate: int) -> NDArray[np.float64]:
    """Return the times (N,) of a span's frames [s]."""
    return span.start_s + np.arange(int((span.stop_s - span.start_s) * rate + 1e-6) + 1) / rate


def rollout_of_span(
    tracks: Tracks,
    topics: TopicMap,
    span: Span,
    *,
    robot: str,
    joint_names: Sequence[str],
    base_height_m: float,
    rate: int,
    name: str,
    scene: str,
    split: str,
) -> Rollout:
    """Return a span as a rollout at `STATE_RATE_HZ`; what the log lacks has no columns.

    Its floor is an estimate, see `floor_heights`, for a log does not say where it climbs stairs.

    Args:
        joint_names: The joints to keep, in order.
        base_height_m: Height of the base over the floor at the span's start.
        scene: What is held out as a whole.
    """
    frames = frame_times(span, rate)
    count = (len(frames) - 1) * (STATE_RATE_HZ // rate) + 1
    times = span.start_s + np.arange(count) / STATE_RATE_HZ
    poses = at_times(tracks.odometry, times)
    position = poses[:, :3]
    nothing = np.empty((count, 0))
    joints = [nothing] * 3
    if tracks.joints is not None and joint_names:
        order = [tracks.joint_names.index(joint) for joint in joint_names]
        parts = np.split(tracks.joints.at(times), 3, axis=1)
        joints = [part[:, order] for part in parts]
    command = nothing if tracks.command is None else tracks.command.last_at(times)
    imu = nothing if tracks.imu is None else tracks.imu.at(times)
    floor_z_m = floor_heights(position[:, 2], base_height_m)
    floor = np.array([*position[0, :2], floor_z_m[0]])
    yaw = float(np.arctan2(*_yaw_parts(poses[0, 3:7])))
    end = EndReason(topics.end_reason)
    return Rollout(
        episode=Episode(
            episode_id=name,
            trajectory_id=name,
            scene_id=scene,
            split=split,
            level=0,
            start_position_world_m=floor,
            start_yaw_rad=yaw,
            goal_position_world_m=np.full(3, UNKNOWN),
            reference_path_world_m=np.empty((0, 3)),
            geodesic_distance_m=UNKNOWN,
            instruction=span.instruction,
        ),
        robot=robot,
        controller="log",
        time_s=times - span.start_s,
        position_world_m=position,
        quat_wxyz=poses[:, 3:7],
        linear_velocity_base_m_s=poses[:, 7:10],
        angular_velocity_base_rad_s=poses[:, 10:13],
        joint_names=tuple(joint_names),
        joint_position_rad=joints[0],
        joint_velocity_rad_s=joints[1],
        joint_torque_nm=joints[2],
        command=command,
        foot_names=(),
        foot_contact=np.empty((count, 0), bool),
        foot_force_n=nothing,
        imu=imu,
        floor_z_m=floor_z_m,
        actions=(),
        events=(),
        end_reason=end,
        metrics=Metrics(
            trajectory_length_m=path_length(position[:, :2]),
            navigation_error_m=UNKNOWN,
            navigation_error_euclidean_m=UNKNOWN,
            success=end in (EndReason.SUCCESS, EndReason.STOPPED_NEAR),
            oracle_success=end in (EndReason.SUCCESS, EndReason.STOPPED_NEAR),
            spl=UNKNOWN,
            ndtw=UNKNOWN,
            fall=end is EndReason.FALL,
            stuck=end is EndReason.STUCK,
            duration_s=float(times[-1] - times[0]),
        ),
        facts={"doubts": list(tracks.doubts), "source_span_s": [span.start_s, span.stop_s]},
    )


def floor_heights(base_z_m: NDArray[np.float64], base_height_m: float) -> NDArray[np.float64]:
    """Return the floor (T,) [m] under a base (T,) that is `base_height_m` over it at the start.

    It is level while the median of 1 s of the base stays within 3 cm, and follows it from there:
    what bobs is a gait, what goes on is stairs, a ramp, or the odometry's drift.
    """
    samples = round(_BOB_S * STATE_RATE_HZ) + 1
    calm_m = median_filter(base_z_m, samples, mode="nearest").tolist()
    followed = accumulate(calm_m, lambda z, base: min(max(z, base - _SWAY_M), base + _SWAY_M))
    return np.array(list(followed)) - base_height_m


def camera_poses(
    path: Path, tracks: Tracks, topics: TopicMap, span: Span, rate: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the optical frame's position (N, 3) [m] and quat_wxyz (N, 4) in the odometry's frame.

    Raises:
        FileFormatError: If no transforms lead from the base to the camera.
    """
    times = frame_times(span, rate)
    pose = np.tile(np.eye(4), (len(times), 1, 1))
    for frame in _mount(path, tracks, topics):
        pose = _matrices(at_times(tracks.frames[frame][1], times)) @ pose
    pose = _matrices(at_times(tracks.odometry, times)) @ pose
    return pose[:, :3, 3], matrix_to_quat(pose[:, :3, :3])


def _mount(path: Path, tracks: Tracks, topics: TopicMap) -> list[str]:
    """Return the frames from the camera's to the one that lies in the base's.

    Raises:
        FileFormatError: If transforms do not lead there.
    """
    frame, passed = tracks.color_frame, list[str]()
    while frame != topics.base_frame:
        if frame not in tracks.frames or frame in passed:
            way = f"from {tracks.color_frame!r} to base_frame, {topics.base_frame!r}"
            reason = f"/tf and /tf_static do not lead {way}: they end at {frame!r}"
            raise FileFormatError(path, reason)
        passed.append(frame)
        frame = tracks.frames[frame][0]
    return passed


def at_times(track: Track, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return interpolated values whose columns 3 to 6 are a quaternion."""
    values = track.values.copy()
    quats = values[:, 3:7]
    flips = np.where(np.sum(quats[1:] * quats[:-1], axis=1) < 0, -1.0, 1.0)
    quats *= np.concatenate([[1.0], np.cumprod(flips)])[:, None]
    result = Track(track.time_s, values).at(times_s)
    result[:, 3:7] /= np.linalg.norm(result[:, 3:7], axis=1, keepdims=True)
    return result


def _matrices(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    result = np.tile(np.eye(4), (len(poses), 1, 1))
    result[:, :3, :3] = quat_to_matrix(poses[:, 3:7])
    result[:, :3, 3] = poses[:, :3]
    return result


def _yaw_parts(quat_wxyz: NDArray[np.float64]) -> tuple[float, float]:
    rotation = quat_to_matrix(quat_wxyz)
    return float(rotation[1, 0]), float(rotation[0, 0])
