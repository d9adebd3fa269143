"""The camera in Foxglove's own schemas: pose, calibration, colour and depth."""

from collections.abc import Iterable, Iterator
from typing import Any

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
    FrameTransforms,
    RawImage,
)

from ..core.arrays import U16, Array
from ..core.frames import matrix_to_quat, quat_to_matrix
from ..core.rollout import Rollout
from ..rendered.folder import FrameFolder
from ..video.codecs import RGB_CODECS
from ..video.mp4 import iterate_depth_codes
from ..video.mux import iterate_bitstream
from .depth_images import depth_encoding, encode_depth
from .recording import Recording, timestamp
from .topics import BASE_FRAME, CAMERA_FRAME, Write, logged, transform

RGB_TOPIC = "/camera/rgb"
DEPTH_TOPIC = "/camera/depth"
CALIBRATION_TOPIC = "/camera/calibration"
CAMERA_TRANSFORM_TOPIC = "/camera/tf"


def camera_messages(
    recording: Recording,
    rollout: Rollout,
    view: FrameFolder,
    depth_codes: Iterable[U16] | None = None,
) -> Iterator[Write]:
    """Yield pose, calibration, colour and depth of each frame.

    Args:
        depth_codes: (H, W) of each frame, if they are known; else the video is decoded.
    """
    context = recording.context
    transforms = FrameTransformsChannel(CAMERA_TRANSFORM_TOPIC, context=context)
    calibrations = CameraCalibrationChannel(CALIBRATION_TOPIC, context=context)
    colours = CompressedVideoChannel(RGB_TOPIC, context=context)
    depths = RawImageChannel(DEPTH_TOPIC, context=context)
    camera, codec = view.camera, RGB_CODECS[view.rgb_codec].canonical
    position, rotation = camera_in_base(rollout, view)
    size: dict[str, Any] = {"width": camera.width_px, "height": camera.height_px}
    projection = np.hstack([camera.intrinsics, np.zeros((3, 1))])
    matrices: dict[str, Any] = {
        name: matrix.ravel().tolist()
        for name, matrix in (("K", camera.intrinsics), ("R", np.eye(3)), ("P", projection))
    }
    encoding, pixel_bytes = depth_encoding(view.depth_range)
    times = rollout.time_s[view.arrays["sample_index"]]
    pictures = zip(
        times,
        iterate_bitstream(view.rgb_video),
        iterate_depth_codes(view.depth_video, view.depth_range)
        if depth_codes is None
        else depth_codes,
        strict=True,
    )
    for i, (time_s, colour, codes) in enumerate(pictures):
        head: dict[str, Any] = {"timestamp": timestamp(time_s), "frame_id": CAMERA_FRAME}
        place = transform(BASE_FRAME, CAMERA_FRAME, time_s, position[i], rotation[i])
        yield logged(transforms, time_s, FrameTransforms(transforms=[place]))
        yield logged(calibrations, time_s, CameraCalibration(**head, **size, **matrices))
        yield logged(colours, time_s, CompressedVideo(**head, data=colour, format=codec))
        data = encode_depth(codes, view.depth_range)
        depth = RawImage(
            **head, **size, encoding=encoding, step=pixel_bytes * camera.width_px, data=data
        )
        yield logged(depths, time_s, depth)


def camera_in_base(rollout: Rollout, view: FrameFolder) -> tuple[Array, Array]:
    """Return position (N, 3) [m] and quat_wxyz (N, 4) of the optical frame in the base frame."""
    samples = view.arrays["sample_index"]
    to_base = quat_to_matrix(rollout.quat_wxyz[samples]).swapaxes(-1, -2)
    offset = view.arrays["camera_position_world_m"] - rollout.position_world_m[samples]
    rotation = to_base @ quat_to_matrix(view.arrays["camera_quat_wxyz"])
    return np.einsum("nij,nj->ni", to_base, offset), matrix_to_quat(rotation)
