"""A span of a robot's log, recorded by ROS 2, as an episode unit."""

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.camera import DepthRange
from ..lerobot import write_episode_unit
from ..rendered.folder import FrameFolder
from ..rendered.image_counts import new_depth_counts, new_rgb_counts
from ..ros2.calibration import Straightener, ideal_camera
from ..ros2.log import bag_name
from ..ros2.pixels import images
from ..ros2.resample import Span, camera_poses, frame_times, image_times_ns, rollout_of_span
from ..ros2.topic_map import TopicMap
from ..ros2.tracks import Tracks
from ..video.mp4 import write_depth_video, write_rgb_video

DEPTH_RANGE = DepthRange(0.05, 20.0)


def unit_from_log(
    path: Path,
    tracks: Tracks,
    topics: TopicMap,
    span: Span,
    folder: Path,
    *,
    robot: str,
    joint_names: Sequence[str],
    base_height_m: float,
    rate: int,
    split: str,
    rgb_codec: str = "h264",
) -> None:
    """Write a span as a unit; depth that the log lacks is invalid everywhere.

    Raises:
        FileFormatError: If images are damaged or missing.
    """
    camera = ideal_camera(tracks.camera_info)
    times, depth = frame_times(span, rate), tracks.depth
    position, rotation = camera_poses(path, tracks, topics, span, rate)
    rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
    folder.parent.mkdir(parents=True, exist_ok=True)

    def depths() -> Iterator[NDArray[np.float32]]:
        if depth is None:
            for _ in times:
                yield np.zeros((camera.height_px, camera.width_px), np.float32)
        else:
            image_times = image_times_ns(tracks, depth, times)
            straighten = Straightener(tracks.depth_info, camera)
            yield from images(path, topics.depth, image_times, straighten, depth=True)

    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".vlnpe-tmp-") as temporary:
        rgb_video, depth_video = Path(temporary) / "rgb.mp4", Path(temporary) / "depth.mp4"
        image_times = image_times_ns(tracks, tracks.color, times)
        straighten = Straightener(tracks.camera_info, camera)
        colors = images(path, topics.color, image_times, straighten, depth=False)
        write_rgb_video(rgb_video, colors, rate, rgb_codec, rgb_counts)
        write_depth_video(depth_video, depths(), rate, DEPTH_RANGE, depth_counts)
        rollout = rollout_of_span(
            tracks,
            topics,
            span,
            robot=robot,
            joint_names=joint_names,
            base_height_m=base_height_m,
            rate=rate,
            name=folder.name,
            scene=bag_name(path),  # episodes of a log share a place
            split=split,
        )
        view = FrameFolder(
            rgb_video=rgb_video,
            depth_video=depth_video,
            arrays={
                "sample_index": rollout.frame_samples(rate),
                "camera_position_world_m": position,
                "camera_quat_wxyz": rotation,
                "rgb_counts": rgb_counts,
                "depth_counts": depth_counts,
            },
            camera=camera,
            depth_range=DEPTH_RANGE,
            frames_per_second=rate,
            light="real",
            rgb_codec=rgb_codec,
            facts={},
        )
        write_episode_unit(folder, rollout, view)
