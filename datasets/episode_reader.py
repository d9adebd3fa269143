"""Frames of an episode as arrays: rows from Parquet, images by decoding the video once through."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from av import VideoFrame
from av.video.reformatter import Interpolation, VideoReformatter
from numpy.typing import NDArray

from ..formats.core.camera import DepthRange
from ..formats.core.errors import FileFormatError
from ..formats.lerobot.layout import DEPTH_KEY, RGB_KEY
from ..formats.untrusted.files import check_input
from ..formats.untrusted.tables import check_size
from ..formats.video.depth_codes import (
    DEPTH_PIXEL_FORMAT,
    SHIFT_M,
    codes_to_depth,
    decode_depth_tiff,
)
from .episode_index import DatasetIndex, EpisodeEntry
from .video_cursor import OpenVideos

_NEAREST_VALID_M = 1e-3  # any: code 0 alone means invalid


class EpisodeReader:
    """Reads one dataset's episodes; picklable, so that workers get their own.

    Args:
        size_px: side of the square images to give; None leaves them as they are.
        videos: kept open; shared between readers of one process.
    """

    def __init__(
        self, index: DatasetIndex, size_px: int | None = None, videos: OpenVideos | None = None
    ):
        self.index = index
        self._size = size_px
        self._videos = videos or OpenVideos()
        self._depth_is_image = index.shapes.get(DEPTH_KEY, ("", ()))[0] == "image"
        self._depth_range = _depth_range(index)

    def rows(self, entry: EpisodeEntry, keys: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Return the columns (T, D) of the episode's frame rows, in the dataset's types.

        Raises:
            FileFormatError: damaged, or a column is missing.
        """
        missing = sorted(set(keys) - set(self.index.shapes))
        if missing:
            raise FileFormatError(
                self.index.root,
                f"has no {', '.join(missing)}; it has {', '.join(sorted(self.index.shapes))}",
            )
        table = _episode_table(entry, keys)
        return {key: _matrix(table[key]) for key in keys}

    def rgbd(
        self, entry: EpisodeEntry, first: int = 0, count: int | None = None
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return `rgb` and `depth_m`, decoded on two threads: decoders release the GIL."""
        # Opened here: two threads must not change what is open.
        rgb = self._frames(RGB_KEY, entry, first, count)
        if self._depth_is_image:
            return self._rgb(rgb), self.depth_m(entry, first, count)
        depth = self._frames(DEPTH_KEY, entry, first, count)
        with ThreadPoolExecutor(1) as pool:
            later = pool.submit(self._depth_of_codes, depth)
            return self._rgb(rgb), later.result()

    def rgb(
        self, entry: EpisodeEntry, first: int = 0, count: int | None = None
    ) -> NDArray[np.uint8]:
        """Return RGB images (T, H, W, 3) of `count` frames from the episode's `first` on.

        Raises:
            FileFormatError: the video is damaged.
        """
        return self._rgb(self._frames(RGB_KEY, entry, first, count))

    def depth_m(
        self, entry: EpisodeEntry, first: int = 0, count: int | None = None
    ) -> NDArray[np.float32]:
        """Return the depth images (T, H, W) [m], 0 = invalid; scaled by picking the nearest pixel.

        Raises:
            FileFormatError: the video, or an image, is damaged.
        """
        if not self._depth_is_image:
            return self._depth_of_codes(self._frames(DEPTH_KEY, entry, first, count))
        first, count = _part(entry, first, count)
        images = _episode_table(entry, [DEPTH_KEY]).slice(first, count)[DEPTH_KEY].to_pylist()
        try:
            millimetres = [self._sized(decode_depth_tiff(image["bytes"])) for image in images]
        except ValueError as error:
            raise FileFormatError(entry.rows, f"episode {entry.number}: {error}") from error
        return np.stack(millimetres).astype(np.float32) / np.float32(1000)

    def _rgb(self, frames: Iterator[VideoFrame]) -> NDArray[np.uint8]:
        # One for all frames, because setting up its conversion tables costs more than using them.
        converter = VideoReformatter()
        images = [
            converter.reformat(
                frame, self._size, self._size, "rgb24", interpolation=Interpolation.AREA
            ).to_ndarray()
            for frame in frames
        ]
        return np.stack(images).astype(np.uint8, copy=False)

    def _depth_of_codes(self, frames: Iterator[VideoFrame]) -> NDArray[np.float32]:
        images = [self._sized(frame.to_ndarray(format=DEPTH_PIXEL_FORMAT)) for frame in frames]
        return codes_to_depth(np.stack(images), self._depth_range)

    def _sized(self, depth: NDArray) -> NDArray[np.uint16]:
        if not self._size:
            return depth
        # Averages of valid and invalid would be depths that nothing has.
        size = (self._size, self._size)
        return np.asarray(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT), np.uint16)

    def _frames(
        self, key: str, entry: EpisodeEntry, first: int, count: int | None
    ) -> Iterator[VideoFrame]:
        if key not in entry.videos:
            raise FileFormatError(self.index.root, f"has no video {key}")
        place, rate = entry.videos[key], self.index.frames_per_second
        start = round(place.from_s * rate)
        first, count = _part(entry, first, count)
        return self._videos.cursor(place.path, rate).frames(start + first, count)


def _part(entry: EpisodeEntry, first: int, count: int | None) -> tuple[int, int]:
    """Return the range of frames: all from `first` on, or `count` of them."""
    if count is None:
        count = entry.length - first
    if first < 0 or count < 1 or first + count > entry.length:
        raise ValueError(f"frames {first} … {first + count - 1}; valid: 0 … {entry.length - 1}")
    return first, count


def _depth_range(index: DatasetIndex) -> DepthRange:
    info = index.info["features"].get(DEPTH_KEY, {}).get("info", {})
    settings = tuple(info.get(f"video.{n}") for n in ("depth_min", "shift", "use_log"))
    is_video = index.shapes.get(DEPTH_KEY, ("", ()))[0] == "video"
    if is_video and settings != (0.0, SHIFT_M, True):
        raise FileFormatError(
            index.root, f"depth_min, shift, use_log are {settings}; valid: 0.0, {SHIFT_M}, True"
        )
    far_m = info.get("video.depth_max")
    if not is_video:
        return DepthRange(_NEAREST_VALID_M, 1.0)  # unused: images hold millimetres
    if (
        isinstance(far_m, bool)
        or not isinstance(far_m, int | float)
        or not far_m > _NEAREST_VALID_M
    ):
        raise FileFormatError(
            index.root, f"video.depth_max of {DEPTH_KEY} is {far_m!r}; valid: metres"
        )
    return DepthRange(_NEAREST_VALID_M, float(far_m))


def _episode_table(entry: EpisodeEntry, keys: Sequence[str]) -> pa.Table:
    """Read the row groups that hold the episode; ours has one per episode."""
    path: Path = entry.rows
    check_input(path)
    try:
        with pq.ParquetFile(path) as file:
            check_size(path, file, ["index", *keys])
            groups = _groups(file, entry)
            table = file.read_row_groups(groups, columns=["index", *keys])
        table.validate(full=True)  # texts that are not UTF-8 would fail where they are used
    except (OSError, pa.ArrowException) as error:
        raise FileFormatError(path, f"not readable ({error})") from error
    numbers = table["index"].to_numpy()
    begin = int(np.searchsorted(numbers, entry.first_frame))
    table = table.slice(begin, entry.length)
    if table.num_rows != entry.length or table["index"][0].as_py() != entry.first_frame:
        raise FileFormatError(path, f"does not hold all frames of episode {entry.number}")
    return table


def _groups(file: pq.ParquetFile, entry: EpisodeEntry) -> list[int]:
    """Return the row groups that may hold frames of the episode, by statistics of `index`."""
    metadata = file.metadata
    names = [metadata.schema.column(c).path for c in range(metadata.num_columns)]
    column = names.index("index")
    last = entry.first_frame + entry.length - 1
    groups = []
    for number in range(metadata.num_row_groups):
        bounds = metadata.row_group(number).column(column).statistics
        elsewhere = (
            bounds is not None
            and bounds.has_min_max
            and (bounds.min > last or bounds.max < entry.first_frame)
        )
        if not elsewhere:
            groups.append(number)
    return groups


def _matrix(column: pa.ChunkedArray) -> NDArray[Any]:
    array = column.combine_chunks()
    # LeRobot's merge writes lists without a fixed size.
    if pa.types.is_fixed_size_list(array.type) or pa.types.is_list(array.type):
        return array.flatten().to_numpy().reshape(len(array), -1)
    return array.to_numpy(zero_copy_only=False)[:, None]
