"""A rollout with its rendered frames as one MCAP file that tells the whole episode.

Everything `write_rollout` writes, and: colour as the video's own packets (CompressedVideo, no loss
beyond the video's), depth as 16-bit millimetres (RawImage 16UC1, 0 = invalid), camera calibration,
the camera's transform, commands, executed actions, the instruction, the reference path, and the
scene's map as attachment. `read_rollout` reads these files, too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove.channels import (
    CameraCalibrationChannel,
    CompressedVideoChannel,
    FrameTransformsChannel,
    RawImageChannel,
)
from foxglove.messages import (
    CameraCalibration,
    CompressedVideo,
    FrameTransform,
    FrameTransforms,
    RawImage,
)
from numpy.typing import NDArray

from ..depth_codes import codes_to_millimetres
from ..errors import FileFormatError
from ..frame_folder import FrameFolder, read_frame_folder
from ..frames import matrix_to_quat, quat_to_matrix
from ..rollout import STATE_RATE_HZ, Rollout
from ..video import RGB_CODECS, iterate_bitstream, iterate_depth_codes, probe_video
from .facts import JSON_KEY, METADATA_NAME, rollout_facts
from .plan import plan_messages
from .recording import Recording, nanoseconds, open_recording, timestamp
from .rollout import SHOW_EVERY
from .topics import (
    BASE_FRAME,
    CAMERA_FRAME,
    Write,
    event_messages,
    motion_messages,
    quaternion,
    state_messages,
    vector,
    write_in_order,
)

RGB_TOPIC = "/camera/rgb"
DEPTH_TOPIC = "/camera/depth"
CALIBRATION_TOPIC = "/camera/calibration"
CAMERA_TRANSFORM_TOPIC = "/camera/tf"
COMMAND_TOPIC = "/command"
ACTION_TOPIC = "/action"
IMU_TOPIC = "/imu"
FOOT_TOPIC = "/foot_contact"


def write_episode_mcap(
    path: Path, rollout: Rollout, frames: Path, *, scene_map: bytes | None = None
) -> None:
    """Write the episode atomically; all times are simulation times.

    Args:
        path: output.
        rollout: physics truth.
        frames: folder that the render stage wrote for this rollout.
        scene_map: PNG picture of the scene seen from above, attached when given.

    Raises:
        FileFormatError: the frames are damaged, or not of this rollout.
        ValueError: the depth range does not fit into 16 bits of millimetres.
    """
    view = read_frame_folder(frames)
    samples = view.arrays["sample_index"]
    expected = rollout.frame_samples(view.frames_per_second)
    if not np.array_equal(samples, expected[: len(samples)]) or len(samples) == 0:
        raise FileFormatError(frames, f"{len(samples)} frames that are not of this rollout")
    for video in (view.rgb_video, view.depth_video):
        if (count := probe_video(video).frames) != len(samples):
            raise FileFormatError(video, f"{count} frames, there are {len(samples)} poses")
    # Where there is a frame there is a base pose, whatever the frame rate.
    every = math.gcd(SHOW_EVERY, STATE_RATE_HZ // view.frames_per_second)
    with open_recording(path) as recording:
        writer = recording.writer
        writer.write_metadata(METADATA_NAME, rollout_facts(rollout))
        writer.write_metadata("vlnpe.instruction", {"text": rollout.episode.instruction})
        writer.write_metadata("vlnpe.view", {JSON_KEY: json.dumps(view.facts, ensure_ascii=False)})
        if scene_map is not None:
            writer.attach(
                log_time=0,
                create_time=0,
                name="scene_map.png",
                media_type="image/png",
                data=scene_map,
            )
        write_in_order(
            plan_messages(recording, rollout),
            state_messages(recording, rollout),
            motion_messages(recording, rollout, every),
            _command_messages(recording, rollout, every),
            _imu_messages(recording, rollout, every),
            _foot_messages(recording, rollout, every),
            _action_messages(recording, rollout),
            _camera_messages(recording, rollout, view),
            event_messages(recording, rollout),
        )


def _camera_messages(recording: Recording, rollout: Rollout, view: FrameFolder) -> Iterator[Write]:
    """Pose, calibration, colour and depth of each frame."""
    context = recording.context
    transforms = FrameTransformsChannel(CAMERA_TRANSFORM_TOPIC, context=context)
    calibrations = CameraCalibrationChannel(CALIBRATION_TOPIC, context=context)
    colours = CompressedVideoChannel(RGB_TOPIC, context=context)
    depths = RawImageChannel(DEPTH_TOPIC, context=context)
    camera, codec = view.camera, RGB_CODECS[view.rgb_codec].canonical
    position, rotation = _camera_in_base(rollout, view)
    intrinsics = camera.intrinsics
    projection = np.hstack([intrinsics, np.zeros((3, 1))])
    times = rollout.time_s[view.arrays["sample_index"]]
    pictures = zip(
        times,
        iterate_bitstream(view.rgb_video),
        iterate_depth_codes(view.depth_video),
        strict=True,
    )
    for i, (time_s, colour, codes) in enumerate(pictures):
        at, stamp = nanoseconds(time_s), timestamp(time_s)
        pose = FrameTransform(
            timestamp=stamp,
            parent_frame_id=BASE_FRAME,
            child_frame_id=CAMERA_FRAME,
            translation=vector(position[i]),
            rotation=quaternion(rotation[i]),
        )
        calibration = CameraCalibration(
            timestamp=stamp,
            frame_id=CAMERA_FRAME,
            width=camera.width_px,
            height=camera.height_px,
            K=intrinsics.ravel().tolist(),
            R=np.eye(3).ravel().tolist(),
            P=projection.ravel().tolist(),
        )
        image = CompressedVideo(timestamp=stamp, frame_id=CAMERA_FRAME, data=colour, format=codec)
        depth = RawImage(
            timestamp=stamp,
            frame_id=CAMERA_FRAME,
            width=camera.width_px,
            height=camera.height_px,
            encoding="16UC1",
            step=2 * camera.width_px,
            data=codes_to_millimetres(codes, view.depth_range).astype("<u2").tobytes(),
        )

        def write(
            at: int = at,
            pose: FrameTransform = pose,
            calibration: CameraCalibration = calibration,
            image: CompressedVideo = image,
            depth: RawImage = depth,
        ) -> None:
            transforms.log(FrameTransforms(transforms=[pose]), log_time=at)
            calibrations.log(calibration, log_time=at)
            colours.log(image, log_time=at)
            depths.log(depth, log_time=at)

        yield at, write


def _camera_in_base(
    rollout: Rollout, view: FrameFolder
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position (N, 3) [m] and quat_wxyz (N, 4) of the optical frame in the base frame."""
    samples = view.arrays["sample_index"]
    to_base = quat_to_matrix(rollout.quat_wxyz[samples]).swapaxes(-1, -2)
    offset = view.arrays["camera_position_world_m"] - rollout.position_world_m[samples]
    rotation = to_base @ quat_to_matrix(view.arrays["camera_quat_wxyz"])
    return np.einsum("nij,nj->ni", to_base, offset), matrix_to_quat(rotation)


def _command_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Velocity commands."""
    names = ("vx_base_m_s", "vy_base_m_s", "yaw_rate_rad_s")
    channel = _json_channel(
        recording, COMMAND_TOPIC, "vlnpe.Command", dict.fromkeys(names, "number")
    )
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.command[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def _imu_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """What the inertial sensor in the base feels."""
    names = [f"specific_force_{c}_base_m_s2" for c in "xyz"]
    names += [f"angular_rate_{c}_base_rad_s" for c in "xyz"]
    channel = _json_channel(recording, IMU_TOPIC, "vlnpe.Imu", dict.fromkeys(names, "number"))
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.imu[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def _foot_messages(recording: Recording, rollout: Rollout, every: int) -> Iterator[Write]:
    """Which feet touch, by name."""
    names = rollout.foot_names
    if not names:
        return
    fields = dict.fromkeys(names, "boolean")
    channel = _json_channel(recording, FOOT_TOPIC, "vlnpe.FootContact", fields)
    for i in range(0, len(rollout.time_s), every):
        at = nanoseconds(rollout.time_s[i])
        message: dict[str, Any] = dict(zip(names, rollout.foot_contact[i].tolist(), strict=True))
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def _action_messages(recording: Recording, rollout: Rollout) -> Iterator[Write]:
    """Executed discrete actions, when they begin."""
    if not rollout.actions:
        return
    fields = {"id": "integer", "name": "string"}
    channel = _json_channel(recording, ACTION_TOPIC, "vlnpe.Action", fields)
    last = len(rollout.time_s) - 1
    for span in rollout.actions:
        at = nanoseconds(rollout.time_s[min(span.start_sample, last)])
        message = {"id": int(span.action), "name": span.action.name}
        yield at, lambda message=message, at=at: channel.log(message, log_time=at)


def _json_channel(
    recording: Recording, topic: str, title: str, fields: dict[str, str]
) -> foxglove.Channel:
    properties = {name: {"type": kind} for name, kind in fields.items()}
    schema = {"type": "object", "title": title, "properties": properties}
    return foxglove.Channel(topic, schema=schema, context=recording.context)
