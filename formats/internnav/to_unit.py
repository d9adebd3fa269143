"""An episode of the VLN-PE layout as an episode unit.

Our own data comes back as it was, except colours (encoded again) and depth beyond 10 m (lost by
the layout). Others' data lacks much; `Assumptions.note` lists what is assumed, derived or missing.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ..core.camera import DepthRange
from ..core.errors import FileFormatError
from ..lerobot import layout as v3
from ..lerobot.statistics import picture_statistics
from ..lerobot.units.parts import UnitParts, write_unit
from ..lerobot.units.rows import stores_images, unit_rows, with_depth_images
from ..rendered.image_counts import new_depth_counts, new_rgb_counts
from ..video.mp4 import write_depth_video, write_rgb_video
from . import layout
from .foreign import DEPTH_RANGE, Assumptions, foreign_parts
from .reader import LayoutEpisode, SceneFolder, read_layout_episode


@dataclass(frozen=True)
class LayoutFacts:
    """Facts of a converted episode.

    Attributes:
        ours: vlnpe wrote it, and nothing had to be assumed.
        finish_status, fail_reason: as written.
        fps: of info.json.
        timestamp_step_s: seconds between rows by their timestamps; None if unknown.
    """

    ours: bool
    finish_status: str
    fail_reason: str
    fps: Any
    timestamp_step_s: float | None


def unit_from_layout(
    scene: SceneFolder, number: int, folder: Path, assumptions: Assumptions
) -> LayoutFacts:
    """Write one episode as a unit.

    Raises:
        FileFormatError: the episode is damaged.
        InputError: If the robot or the height of its base is unknown.
    """
    episode = read_layout_episode(scene.folder, number)
    height, width = episode.rgb.shape[1:3]
    if height % 2 or width % 2:
        raise FileFormatError(scene.folder, f"images of {width} × {height}; valid: even sizes")
    own = None if episode.unit is None else _own_parts(episode, scene.folder)
    if own is None:
        depth_range, codec = DEPTH_RANGE, assumptions.rgb_codec
        rate = assumptions.frames_per_second
    else:
        columns, rate = own[0].columns, own[0].frames_per_second
        depth_range = DepthRange(columns["depth_near_m"], columns["depth_far_m"])
        codec = str(own[0].features[v3.RGB_KEY]["info"]["video.codec"])

    def make(temporary: Path) -> tuple[UnitParts, pa.Table]:
        rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
        rgb, depth = temporary / f"{v3.RGB_KEY}.mp4", temporary / f"{v3.DEPTH_KEY}.mp4"
        write_rgb_video(rgb, episode.rgb, rate, codec, rgb_counts)
        write_depth_video(depth, _metres(episode), rate, depth_range, depth_counts)
        parts, rows = own or foreign_parts(scene, number, episode, assumptions, rgb, depth)
        images = stores_images(parts.features)
        if images:
            rows = with_depth_images(rows, parts.features, depth, depth_range)
            depth.unlink()
        seen = picture_statistics(rgb_counts, depth_counts, depth_range, parts.length, images)
        return replace(parts, statistics={**parts.statistics, **seen}), rows

    write_unit(folder, make)
    return LayoutFacts(
        own is not None,
        episode.finish_status,
        episode.fail_reason,
        episode.info.get("fps"),
        episode.timestamp_step_s,
    )


def _metres(episode: LayoutEpisode) -> Iterator[NDArray[np.float32]]:
    """Return depth images [m]; 0 where the layout stores nothing, or its largest depth."""
    for image in episode.depth:
        stored = np.asarray(image, np.float32)
        with np.errstate(invalid="ignore"):
            seen = (stored > 0) & (stored < 1)
        yield np.where(seen, stored * np.float32(layout.DEPTH_UNIT_M), np.float32(0))


def _own_parts(episode: LayoutEpisode, folder: Path) -> tuple[UnitParts, pa.Table]:
    """Return index and rows of the unit that our own writer was given."""
    try:
        parts = UnitParts.from_json(episode.unit or {}, folder / layout.UNITS_PATH)
        return parts, unit_rows(episode.columns, parts.features)
    except (KeyError, TypeError, ValueError, pa.ArrowException) as error:
        raise FileFormatError(folder / layout.UNITS_PATH, f"damaged: {error!r}") from error
