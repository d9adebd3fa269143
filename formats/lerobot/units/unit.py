"""One episode as one atomic folder, ready to be copied into a LeRobot dataset.

    <unit>/
      rows.parquet   frame rows without the columns that depend on the place in a dataset
      observation.images.rgb.mp4, observation.images.depth.mp4 (unless depth is in the rows)
      unit.json      features, task, statistics, episode columns

Units are independent, so any number of processes may write them; a unit is whole or absent.
"""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa

from ...core.arrays import F32, I64, U16
from ...core.atomic import TEMPORARY_PREFIX
from ...core.camera import CameraModel, DepthRange
from ...core.errors import FileFormatError, check_name
from ...core.rollout import Rollout
from ...rendered.folder import FrameFolder
from ...rendered.image_counts import add_depth_codes, add_rgb, new_depth_counts, new_rgb_counts
from ...rendered.table import FrameTable, build_frame_table
from ...untrusted.documents import read_json_object
from ...untrusted.tables import read_table
from ...video.depth_codes import (
    ANY_NEAR_M,
    DEPTH_PIXEL_FORMAT,
    MAX_CODE,
    codes_to_depth,
    decode_depth_tiff,
)
from ...video.depth_images import CODEC
from ...video.mp4 import (
    iterate_depth_codes,
    iterate_depth_video,
    iterate_rgb_video,
    write_depth_video,
)
from ...video.stream import VideoFacts, pick_frames, probe_video
from ..episode_columns import EPISODE_COLUMNS, LATER_COLUMNS, episode_columns
from ..features import DEPTH_STORAGES, dataset_features
from ..layout import DEPTH_KEY, RGB_KEY
from ..statistics import column_statistics, picture_statistics
from .parts import ROWS, UNIT_INDEX, UnitParts, write_unit
from .rows import stores_images, unit_rows, with_depth_images


@dataclass(frozen=True, kw_only=True)
class EpisodeUnit(UnitParts):
    """A unit in a folder."""

    folder: Path

    def video(self, key: str) -> Path:
        """Return the path of a video."""
        return self.folder / f"{key}.mp4"

    def depth_m(self, numbers: Sequence[int]) -> Iterator[F32]:
        """Yield the depth (H, W) [m] of the frames of the given ascending numbers, 0 = invalid."""
        depth_m, images = self.depth_codes(numbers)
        return (depth_m[codes] for codes in images)

    def depth_codes(self, numbers: Sequence[int]) -> tuple[F32, Iterator[U16]]:
        """Return the depth [m] of each code, 0 = invalid, and the codes (H, W) of the frames."""
        if self.features[DEPTH_KEY]["dtype"] == "video":
            limits = DepthRange(self.columns["depth_near_m"], self.columns["depth_far_m"])
            frames = pick_frames(self.video(DEPTH_KEY), numbers)
            images = (cast(U16, f.to_ndarray(format=DEPTH_PIXEL_FORMAT)) for f in frames)
            return codes_to_depth(np.arange(MAX_CODE + 1, dtype=np.uint16), limits), images
        return np.arange(1 << 16, dtype=np.float32) / np.float32(1000), self._millimetres(numbers)

    def _millimetres(self, numbers: Sequence[int]) -> Iterator[U16]:
        images = self.rows()[DEPTH_KEY]
        for number in numbers:
            try:
                yield decode_depth_tiff(images[number].as_py()["bytes"])
            except (IndexError, TypeError, ValueError) as error:
                reason = f"frame {number} has no depth image"
                raise FileFormatError(self.folder / ROWS, reason) from error

    def rows(self) -> pa.Table:
        """Load the frame rows, as many as the index says."""
        path = self.folder / ROWS
        table = read_table(path)
        if table.num_rows != self.length:
            raise FileFormatError(path, f"{table.num_rows} rows; its index states {self.length}")
        return table


def write_episode_unit(
    folder: Path, rollout: Rollout, frames: FrameFolder, *, depth_storage: str = "video"
) -> None:
    """Write one episode, whatever its outcome, to a folder that is replaced as a whole.

    Args:
        frames: The rendered view. Its videos are linked, or copied where that is impossible. If
            its arrays have `rgb_counts` (3, 256) and `depth_counts` (4096,), the videos need not be
            decoded for their statistics.
        depth_storage: One of `DEPTH_STORAGES`; `image` keeps whole millimetres in the rows.

    Raises:
        UnknownNameError: If `depth_storage` is not one of them.
        ValueError: If the frames do not belong to the rollout.
        FileFormatError: If a video is damaged, or has another length, rate or size.
    """
    check_name("depth storage", depth_storage, DEPTH_STORAGES)
    depth_range, rate = frames.depth_range, frames.frames_per_second
    table = build_frame_table(rollout, frames.arrays, rate)
    rgb = _checked_video(frames.rgb_video, table, frames.camera)
    depth = _checked_video(frames.depth_video, table, frames.camera)
    if depth.codec == CODEC and depth_storage == "video":
        folder.parent.mkdir(parents=True, exist_ok=True)
        prefix = f"{TEMPORARY_PREFIX}{folder.name}."  # as `sweep_beside` knows it
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=prefix) as temporary:
            video, limits = Path(temporary) / "depth.mp4", DepthRange(ANY_NEAR_M, depth_range.far_m)
            images = iterate_depth_video(frames.depth_video, depth_range)
            write_depth_video(video, images, rate, limits)
            return write_episode_unit(folder, rollout, replace(frames, depth_video=video))
    features = dataset_features(table, rgb, depth, frames.rgb_codec, depth_range, depth_storage)
    index = np.arange(len(table))
    columns = table.columns | {"timestamp": index / rate, "frame_index": index}
    statistics = {key: column_statistics(values) for key, values in columns.items()}
    counts = _counts(frames)
    statistics |= picture_statistics(*counts, depth_range, len(table), stores_images(features))
    own = rollout.episode.extra.get("instructions") or [rollout.episode.instruction]
    parts = UnitParts(
        frames_per_second=rate,
        robot=rollout.robot,
        features=features,
        task=rollout.episode.instruction,
        length=len(table),
        statistics=statistics,
        columns=episode_columns(rollout, table, frames.camera, depth_range, frames.light, own),
    )

    def make(temporary: Path) -> tuple[UnitParts, pa.Table]:
        rows = unit_rows(columns, features)
        if stores_images(features):
            rows = with_depth_images(rows, features, frames.depth_video, depth_range)
        else:
            _link(frames.depth_video, temporary / f"{DEPTH_KEY}.mp4")
        _link(frames.rgb_video, temporary / f"{RGB_KEY}.mp4")
        return parts, rows

    write_unit(folder, make)


def read_episode_unit(folder: Path) -> EpisodeUnit:
    """Open a unit."""
    path = folder / UNIT_INDEX
    if not path.is_file():
        raise FileFormatError(path, "missing; not an episode unit")
    try:
        index = read_json_object(path)
        index["columns"] = LATER_COLUMNS | index["columns"]
        missing = set(EPISODE_COLUMNS) - set(index["columns"])
        if missing:
            raise FileFormatError(path, f"episode columns {sorted(missing)} are missing")
        return EpisodeUnit(folder=folder, **vars(UnitParts.from_json(index, path)))
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileFormatError(path, f"not an episode unit: {error!r}") from error


def _checked_video(path: Path, table: FrameTable, camera: CameraModel) -> VideoFacts:
    facts = probe_video(path)
    actual = (facts.frames, facts.frames_per_second, facts.width_px, facts.height_px)
    expected = (len(table), table.frames_per_second, camera.width_px, camera.height_px)
    if actual != expected:
        raise FileFormatError(path, f"frames, rate, width, height {actual}; expected {expected}")
    return facts


def _counts(frames: FrameFolder) -> tuple[I64, I64]:
    """Return how often each colour value and each depth code occurs: (3, 256) and (4096,)."""
    if "rgb_counts" in frames.arrays and "depth_counts" in frames.arrays:
        return frames.arrays["rgb_counts"], frames.arrays["depth_counts"]
    rgb_counts, depth_counts = new_rgb_counts(), new_depth_counts()
    for image in iterate_rgb_video(frames.rgb_video):
        add_rgb(rgb_counts, image)
    for codes in iterate_depth_codes(frames.depth_video, frames.depth_range):
        add_depth_codes(depth_counts, codes)
    return rgb_counts, depth_counts


def _link(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # another file system, or one without links
        shutil.copyfile(source, target)
