"""A rendered view of one rollout on disk: two videos, poses, facts.

rgb.mp4, depth.mp4   see `video`
frames.npz           sample_index (N,), time_s (N,), camera_position_world_m (N, 3) and
                     camera_quat_wxyz (N, 4) of the optical frame; rgb_counts (3, 256) and
                     depth_counts (4096,), see `image_counts`
meta.json            camera, depth range, light, frame rate, codecs
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.camera import CameraModel, DepthRange
from ..core.errors import FileFormatError


@dataclass(frozen=True)
class FrameFolder:
    """An opened folder of rendered frames.

    Attributes:
        rgb_video, depth_video: paths.
        arrays: those of frames.npz.
        camera: the view's intrinsics.
        depth_range: of the depth video.
        frames_per_second: of both videos.
        light: lighting name.
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
    try:
        facts = json.loads(meta.read_text())
        camera, depth = facts["camera"], facts["depth"]
        with np.load(poses, allow_pickle=False) as data:
            arrays = {key: data[key] for key in data.files}
        return FrameFolder(
            rgb_video=folder / facts["rgb"]["file"],
            depth_video=folder / depth["file"],
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
    except FileNotFoundError as error:
        name = Path(str(error.filename)).name
        raise FileFormatError(folder, f"no rendered frames here ({name} is missing)") from error
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        raise FileFormatError(folder, f"rendered frames are damaged: {error!r}") from error
