"""Single frames with history and future, on top of LeRobot's own dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from ..formats.core.errors import InputError, check_name
from ..formats.lerobot.layout import DEPTH_KEY, RGB_KEY
from .episode_index import EpisodeEntry, read_index
from .episode_reader import EpisodeReader
from .instructions import OWN_TEXT, InstructionChoice
from .local import open_dataset
from .selection import Selection, common_columns, select_all
from .video_cursor import OpenVideos

# What every robot has in the same layout.
COMMON = (
    "observation.state",
    "observation.imu",
    "observation.camera_pose",
    "observation.progress",
    "action",
    "action.velocity",
    "action.discrete",
)


@dataclass(frozen=True)
class NavigationConfig:
    """Contents of an item.

    Attributes:
        history: images of how many frames, the current one included.
        future: how many motions, the current one included.
        columns: further features; None takes those of `COMMON` that all datasets have.
        depth: whether to decode depth.
        size_px: side of the square images; None leaves them as they are.
    """

    history: int = 1
    future: int = 1
    columns: tuple[str, ...] | None = None
    depth: bool = True
    size_px: int | None = None

    def __post_init__(self) -> None:
        if min(self.history, self.future) < 1:
            raise InputError(
                f"history {self.history}, future {self.future}; valid: at least 1 each"
            )


class NavigationDataset(Dataset[dict[str, Any]]):
    """Frames of a selection; items go through its episodes in order.

    Keys and conventions are LeRobot's, as with `delta_timestamps` of `history` images and `future`
    actions: windows repeat the episode's edge, `<key>_is_pad` marks where. With one frame a window
    has no time axis. Images come decoded from videos that stay open, not opened for every item.

    | key | type, shape | meaning |
    | --- | --- | --- |
    | observation.images.rgb | uint8 ([K,] 3, H, W) | frames t − K + 1 … t |
    | observation.images.depth | float32 ([K,] 1, H, W) | planar z [m], 0 = invalid |
    | action | float32 ([F,] 3) | Δx, Δy [m], Δyaw [rad] from frames t … t + F − 1 to the next |
    | action.discrete | int64 ([F]) or () | 0 STOP, 1 FORWARD, 2 LEFT, 3 RIGHT |
    | other features | (D) or () | of frame t, in the dataset's types |
    | <key>_is_pad | bool (K) or (F) | outside the episode; only with more than one frame |
    | task, robot, uid | str | the instruction, whose, and which episode |
    | frame_index, episode_index | int64 () | place in the dataset |

    Attributes:
        lerobot: LeRobot's dataset under each folder, with metadata and statistics for policies.
    """

    def __init__(
        self,
        source: Selection | Path,
        config: NavigationConfig = NavigationConfig(),
        instruction_choice: InstructionChoice = OWN_TEXT,
    ):
        """Open `source`, a selection or a dataset's folder.

        Raises:
            FileFormatError: no dataset collected by vlnpe.
            UnknownNameError: a column that not all datasets have in one layout.
            InputError: the extra `train` is not installed.
        """
        selection = source if isinstance(source, Selection) else select_all([read_index(source)])
        shared = common_columns(selection.datasets)
        rows = [k for k, (kind, _) in shared.items() if kind not in ("video", "image")]
        for name in config.columns or ():
            check_name("column in all datasets", name, rows)
        self.selection, self.config, self.instruction_choice = selection, config, instruction_choice
        chosen = config.columns or [key for key in COMMON if key in rows]
        self._now = [k for k in chosen if not k.startswith("action") or k == "action.velocity"]
        self._ahead = [key for key in chosen if key not in self._now]
        self.lerobot = [open_dataset(d.root, video_backend="pyav") for d in selection.datasets]
        videos = OpenVideos()
        self._readers = [EpisodeReader(d, config.size_px, videos) for d in selection.datasets]

    def __len__(self) -> int:
        return self.selection.frames

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the frame `number`, counted through all episodes of the selection."""
        episode, frame = self.selection.place_of_frame(number)
        entry = self.selection.entry(episode)
        dataset = int(self.selection.dataset[episode])
        item = self._columns(dataset, entry, frame) | self._images(dataset, entry, frame)
        item["task"], item["robot"], item["uid"] = (
            self.instruction_choice.text(entry),
            entry.robot,
            entry.uid,
        )
        item["frame_index"] = torch.tensor(frame)
        item["episode_index"] = torch.tensor(entry.number)
        return item

    def _columns(self, dataset: int, entry: EpisodeEntry, frame: int) -> dict[str, Any]:
        ahead = np.arange(frame, frame + self.config.future)
        # LeRobot keeps the rows memory-mapped; a slice of its table costs no copy of the rest.
        rows = self.lerobot[dataset].hf_dataset.data.slice(
            entry.first_frame + frame, min(self.config.future, entry.length - frame)
        )
        item = {key: torch.from_numpy(_row(rows, key))[0] for key in self._now}
        if self.config.future == 1:
            return item | {key: torch.from_numpy(_row(rows, key))[0] for key in self._ahead}
        within = np.minimum(ahead, entry.length - 1) - frame
        for key in self._ahead:
            item[key] = torch.from_numpy(_row(rows, key)[within])
            item[f"{key}_is_pad"] = torch.from_numpy(ahead >= entry.length)
        return item

    def _images(self, dataset: int, entry: EpisodeEntry, frame: int) -> dict[str, Any]:
        reader = self._readers[dataset]
        history = np.arange(frame - self.config.history + 1, frame + 1)
        first = max(int(history[0]), 0)
        count = frame - first + 1
        again = np.maximum(history, 0) - first
        if self.config.depth:
            rgb, depth = reader.rgbd(entry, first, count)
            item = {DEPTH_KEY: torch.from_numpy(depth[again])[:, None]}
        else:
            rgb, item = reader.rgb(entry, first, count), {}
        item[RGB_KEY] = torch.from_numpy(rgb[again]).permute(0, 3, 1, 2)
        for key in list(item):
            if self.config.history == 1:
                item[key] = item[key][0]
            else:
                item[f"{key}_is_pad"] = torch.from_numpy(history < 0)
        return item


def _row(rows: Any, key: str) -> NDArray[Any]:
    """Return a column (N, D), or (N,) of scalars, as LeRobot gives them."""
    array = rows[key].combine_chunks()
    if hasattr(array.type, "value_type"):  # a list, of a fixed size unless LeRobot merged
        return array.flatten().to_numpy().reshape(len(array), -1).copy()
    return array.to_numpy(zero_copy_only=False).copy()
