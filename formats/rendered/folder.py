"""A rendered view of one rollout on disk: two videos, poses, facts.

rgb.mp4, depth.mp4   see `video`; depth is depth.mov where datasets are to store images
frames.npz           sample_index (N,), time_s (N,), camera_position_world_m (N, 3) and
                     camera_quat_wxyz (N, 4) of the optical frame; rgb_counts (3, 256) and
                     depth_counts (4096,), see `image_counts`
meta.json            camera, depth range, light, frame rate, codecs
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..core.camera import CameraModel, DepthRange
from ..core.errors import FileFormatError, brief
from ..untrusted.arrays import read_arrays
from ..untrusted.documents import read_json_object

_VIDEO_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}\.(mp4|mov|mkv)")


@dataclass(frozen=True)
class FrameFolder:
    """An opened folder of rendered frames.

    Attributes:
        arrays: those of frames.npz.
        rgb_codec: key of `video.RGB_CODECS`.
        facts: all of meta.json.
    """

    rgb_video: Path
    depth_video: Path
    arrays: dict[str, NDArray[Any]]
    camera: CameraModel
    depth_range: DepthRange
    frames_per_second: int
    light: str
    rgb_codec: str
    facts: dict[str, Any]


def read_frame_folder(folder: Path) -> FrameFolder:
    """Open a folder of rendered frames; the videos are not read.

    Raises:
        FileFormatError: missing, incomplete or corrupt.
    """
    meta, poses = folder / "meta.json", folder / "frames.npz"
    for path in (meta, poses):
        if not path.is_file():
            raise FileFormatError(folder, f"contains no rendered frames ({path.name} is missing)")
    facts, arrays = read_json_object(meta), read_arrays(poses)
    try:
        camera, depth = facts["camera"], facts["depth"]
        return FrameFolder(
            rgb_video=folder / video_name(facts, "rgb", meta),
            depth_video=folder / video_name(facts, "depth", meta),
            arrays=arrays,
            camera=CameraModel(
                camera["name"], camera["width_px"], camera["height_px"], camera["hfov_deg"]
            ),
            depth_range=DepthRange(depth["near_m"], depth["far_m"]),
            frames_per_second=facts["frames_per_second"],
            light=facts["light"],
            rgb_codec=facts["rgb"]["codec"],
            facts=facts,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(folder, f"rendered frames are damaged: {error!r}") from error


def video_name(facts: Mapping[str, Any], key: str, path: Path) -> str:
    """Return the file name of a view's video, as meta.json or an MCAP file states it.

    Args:
        facts: of meta.json.
        key: `rgb`, `depth` or the name of a label video.
        path: where the facts were read, for errors.

    Raises:
        FileFormatError: not the name of a file beside meta.json.
    """
    entry = facts.get(key)
    name = entry.get("file") if isinstance(entry, Mapping) else None
    if not isinstance(name, str) or not _VIDEO_NAME.fullmatch(name):
        raise FileFormatError(
            path, f"{key}: file {brief(name)}; valid: a plain name like {key}.mp4"
        )
    return name
