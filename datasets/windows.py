"""Windows of waypoints for trajectory-predicting policies such as RDP."""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from ..formats.core.errors import InputError
from .episode_index import EpisodeEntry
from .episode_reader import EpisodeReader
from .instructions import OWN_TEXT, InstructionChoice
from .poses import planar_poses, relative
from .selection import Selection, check_frame_rate
from .tokens import Tokens
from .video_cursor import OpenVideos

_ROWS = ("action", "observation.state", "observation.progress")
_EPISODES_KEPT = 4  # rows of the episodes read last; neighbours are often asked for in turn


@dataclass(frozen=True)
class WindowConfig:
    """Contents of a window.

    Attributes:
        future: number of poses ahead.
        past: number of motions before.
        history: number of images, the current one included.
        size_px: side of the square images; None leaves them as they are.
    """

    future: int = 8
    past: int = 4
    history: int = 1
    size_px: int | None = None

    def __post_init__(self) -> None:
        if min(self.future, self.history) < 1 or self.past < 0:
            raise InputError(
                f"future {self.future}, history {self.history}, past {self.past}; "
                "valid: at least 1, 1 and 0"
            )


class WaypointWindows(Dataset[dict[str, Any]]):
    """One window per frame t; items go through the selection's episodes in order.

    F = `future`, P = `past`, K = `history`:

    | key | type, shape | meaning |
    | --- | --- | --- |
    | rgb | uint8 (K, 3, H, W) | frames t − K + 1 … t; before the start the first frame again |
    | depth | float32 (K, 1, H, W) | planar z [m], 0 = invalid |
    | tokens | int64 (L) | the instruction, see `tokens` |
    | waypoints | float32 (F, 3) | x, y [m], yaw [rad] of frames t + 1 … t + F, seen from t |
    | motions | float32 (F, 3) | Δx, Δy [m], Δyaw [rad] from frame t + k to the next, in its frame |
    | waypoint_valid | bool (F) | false behind the end: the last pose again, motion zero |
    | past_motions | float32 (P, 3) | motions that began at frames t − P … t − 1; zero before the
      start |
    | past_valid | bool (P) | false before the start |
    | pose | float32 (3) | x, y [m], yaw [rad] relative to the episode's first frame |
    | stop_progress | float32 () | 0 at the first frame … 1 at the last, where to stop |
    | uid, robot | str | which episode, and whose |
    | frame | int64 () | t |
    """

    def __init__(
        self,
        selection: Selection,
        tokens: Tokens,
        config: WindowConfig = WindowConfig(),
        instruction_choice: InstructionChoice = OWN_TEXT,
    ):
        """Set up the dataset without reading anything.

        Raises:
            InputError: the datasets' frame rates differ.
        """
        check_frame_rate(selection.datasets)
        self.selection, self.tokens, self.config = selection, tokens, config
        self.instruction_choice = instruction_choice
        videos = OpenVideos()
        self._readers = [EpisodeReader(d, config.size_px, videos) for d in selection.datasets]
        self._rows: OrderedDict[int, dict[str, NDArray[Any]]] = OrderedDict()

    def __len__(self) -> int:
        return self.selection.frames

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the window of frame `number`, counted through all episodes."""
        episode, frame = self.selection.place_of_frame(number)
        entry = self.selection.entry(episode)
        reader = self._readers[self.selection.dataset[episode]]
        rows = self._episode_rows(episode, entry, reader)
        poses, motion = planar_poses(rows["observation.state"]), rows["action"]
        ahead, behind = self._neighbours(frame)
        last = entry.length - 1
        item: dict[str, Any] = {
            "tokens": torch.from_numpy(self.tokens.encode(self.instruction_choice.text(entry))),
            "waypoints": _floats(relative(poses, frame)[np.minimum(ahead, last)]),
            "motions": _floats(motion[np.minimum(ahead - 1, last)]),
            "waypoint_valid": torch.from_numpy(ahead <= last),
            "past_motions": _floats(motion[np.maximum(behind, 0)] * (behind >= 0)[:, None]),
            "past_valid": torch.from_numpy(behind >= 0),
            "pose": _floats(relative(poses, 0)[frame]),
            "stop_progress": _floats(rows["observation.progress"][frame, 0]),
            "uid": entry.uid,
            "robot": entry.robot,
            "frame": torch.tensor(frame),
        }
        return item | self._images(reader, entry, frame)

    def _neighbours(self, frame: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the frames of the waypoints ahead, and of the motions before."""
        config = self.config
        return np.arange(1, config.future + 1) + frame, np.arange(-config.past, 0) + frame

    def _images(self, reader: EpisodeReader, entry: EpisodeEntry, frame: int) -> dict[str, Any]:
        first = max(frame - self.config.history + 1, 0)
        missing = self.config.history - (frame - first + 1)
        again = np.maximum(np.arange(-missing, frame - first + 1), 0)
        rgb, depth = reader.rgbd(entry, first, frame - first + 1)
        return {
            "rgb": torch.from_numpy(rgb[again]).permute(0, 3, 1, 2),
            "depth": torch.from_numpy(depth[again])[:, None],
        }

    def _episode_rows(
        self, episode: int, entry: EpisodeEntry, reader: EpisodeReader
    ) -> dict[str, NDArray[Any]]:
        if episode not in self._rows:
            while len(self._rows) >= _EPISODES_KEPT:
                self._rows.popitem(last=False)
            self._rows[episode] = reader.rows(entry, _ROWS)
        self._rows.move_to_end(episode)
        return self._rows[episode]


def _floats(values: Any) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, np.float32))
