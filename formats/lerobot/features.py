"""Entries of info.json's `features`: what each column is, and how each video was encoded."""

from typing import Any

from ..core.camera import DepthRange
from ..rendered.table import FrameTable
from ..video.codecs import DEPTH_CODEC, GROUP_OF_PICTURES, RGB_CODECS, VideoCodec
from ..video.depth_codes import SHIFT_M
from ..video.stream import VideoFacts
from .layout import DEPTH_KEY, RGB_KEY, Features, automatic_features

IMAGE_NAMES = ["height", "width", "channels"]
# Depth is kept as a lossless video of 12-bit codes, or images of whole millimetres in the rows.
DEPTH_STORAGES = ("video", "image")


def dataset_features(
    table: FrameTable,
    rgb: VideoFacts,
    depth: VideoFacts,
    rgb_codec: str,
    depth_range: DepthRange,
    depth_storage: str = "video",
) -> Features:
    """Return the features of a dataset of one robot and one camera view."""
    features: Features = {
        key: {"dtype": str(column.dtype), "shape": [column.shape[1]], "names": names}
        for key, column, names in zip(
            table.columns, table.columns.values(), table.column_names.values(), strict=True
        )
    }
    features[RGB_KEY] = {
        "dtype": "video",
        "shape": [rgb.height_px, rgb.width_px, 3],
        "names": IMAGE_NAMES,
        "info": _video_info(rgb, RGB_CODECS[rgb_codec], 3) | {"is_depth_map": False},
    }
    image = depth_storage == "image"
    millimetres = {"is_depth_map": True, "depth_unit": "mm"}
    features[DEPTH_KEY] = {
        "dtype": depth_storage,
        "shape": [depth.height_px, depth.width_px, 1],
        "names": IMAGE_NAMES,
        "info": millimetres if image else _depth_video_info(depth, depth_range),
    }
    return features | automatic_features()


def _depth_video_info(facts: VideoFacts, depth_range: DepthRange) -> dict[str, Any]:
    return {
        "is_depth_map": True,
        "depth_unit": "m",
        **_video_info(facts, DEPTH_CODEC, 1),
        # The parameters by which LeRobot turns codes into depth again.
        "video.depth_min": 0.0,
        "video.depth_max": depth_range.far_m,
        "video.shift": SHIFT_M,
        "video.use_log": True,
    }


def _video_info(facts: VideoFacts, codec: VideoCodec, channels: int) -> dict[str, Any]:
    return {
        "video.height": facts.height_px,
        "video.width": facts.width_px,
        "video.codec": facts.codec,
        "video.pix_fmt": facts.pixel_format,
        "video.fps": facts.frames_per_second,
        "video.channels": channels,
        "has_audio": False,
        "video.g": GROUP_OF_PICTURES,
        "video.crf": codec.crf,
        "video.preset": codec.preset,
        "video.fast_decode": 0,
        "video.video_backend": "pyav",
        "video.extra_options": codec.extra_options,
    }
