"""Whole episodes for recurrent models (Seq2Seq, CMA), as VLN-CE trains them by imitation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.utils.rnn import PackedSequence, pack_padded_sequence
from torch.utils.data import Dataset

from ..formats.core.errors import FileFormatError, InputError
from ..formats.core.rollout import DAGGER, DISCRETE_RATE_HZ
from ..formats.rendered.discrete_steps import discrete_steps
from ..formats.rendered.table import EXECUTED, LABEL
from .episode_reader import EpisodeReader
from .instructions import OWN_TEXT, InstructionChoice
from .poses import future_poses, motions, planar_poses, relative
from .selection import Selection, check_frame_rate
from .tokens import Tokens
from .video_cursor import OpenVideos

ACTIONS = 4  # STOP, FORWARD, LEFT, RIGHT
# VLN-CE's: frames per change of action in R2R's trajectories.
INFLECTION_COEFFICIENT = 3.2
_ROWS = ("observation.state", "observation.progress")


@dataclass(frozen=True)
class SequenceConfig:
    """Contents of a sequence.

    Attributes:
        size_px: side of the square images; None leaves them as they are.
        max_steps: T at most; a longer episode is cut there and says so in `cut`.
        inflection_coefficient: weight of a step whose action differs from the one before.
        future: number of poses ahead to give at each step; 0 gives none.
        images: whether to decode them at all.
        every_frame: take all frames, as they follow in time, with `action.discrete`, instead of
            discrete steps.
    """

    size_px: int | None = None
    max_steps: int = 200
    inflection_coefficient: float = INFLECTION_COEFFICIENT
    future: int = 0
    images: bool = True
    every_frame: bool = False

    def __post_init__(self) -> None:
        if self.max_steps < 1 or (self.size_px is not None and self.size_px < 8):
            raise InputError(
                f"max_steps {self.max_steps}, size_px {self.size_px}; valid: at least 1 and 8"
            )


class EpisodeSequences(Dataset[dict[str, Any]]):
    """Whole episodes; item n is episode n of the selection.

    An item has T ≤ `max_steps` discrete steps: each action is the motion from one step's frame to
    the next one's, so that executing the actions leads along the robot's path to its end (see
    `formats.rendered.discrete_steps`). With `every_frame`, and in walks of DAgger, the steps are
    the frames (0.25 s each), and each action is what the expert would do there (`action.discrete`).

    | key | type, shape | meaning |
    | --- | --- | --- |
    | rgb | uint8 (T, 3, H, W) | what is seen before the action |
    | depth | float32 (T, 1, H, W) | planar z [m], 0 = invalid |
    | tokens | int64 (L) | the instruction, see `tokens` |
    | action | int64 (T) | 0 STOP, 1 FORWARD, 2 LEFT, 3 RIGHT; STOP is the last and no other |
    | previous_action | int64 (T) | 0 at the first step, else 1 + the action executed before (in
      walks of DAgger not always the label) |
    | weight | float32 (T) | inflection weight: the coefficient where the action changes (and at
      the first step), else 1 |
    | progress | float32 (T) | 0 … 1 |
    | motion | float32 (T, 3) | Δx, Δy [m], Δyaw [rad] to the next step, in this step's frame |
    | pose | float32 (T, 3) | x, y [m], yaw [rad] relative to the first frame |
    | waypoints | float32 (T, F, 3) | x, y [m], yaw [rad] of the F = `future` steps behind each,
      seen from it; the last pose is repeated behind the end |
    | waypoint_valid | bool (T, F) | false behind the end, and in walks of DAgger, whose motion is
      not the expert's |
    | length | int64 () | T |
    | cut | bool () | whether the episode goes on |
    | uid, robot | str | which episode, and whose |
    """

    def __init__(
        self,
        selection: Selection,
        tokens: Tokens,
        config: SequenceConfig = SequenceConfig(),
        instruction_choice: InstructionChoice = OWN_TEXT,
    ):
        """Set up the dataset without reading anything.

        Raises:
            InputError: the datasets' frame rates differ, or, with `every_frame`, they have no
                discrete actions (4 frames/s have them).
            FileFormatError: walks of DAgger lack the executed actions.
        """
        rate = check_frame_rate(selection.datasets)
        if config.every_frame and rate != DISCRETE_RATE_HZ:
            raise InputError(
                f"{selection.datasets[0].root}: {rate} frames/s have no discrete actions; "
                f"valid: {DISCRETE_RATE_HZ}"
            )
        for index in selection.datasets:
            if DAGGER in index.labels("controller") and EXECUTED not in index.shapes:
                raise FileFormatError(
                    index.root,
                    f"lacks {EXECUTED}, for an older version recorded it; run `vlnpe dagger` with "
                    "its --out again",
                )
        self.selection, self.tokens, self.config = selection, tokens, config
        self.instruction_choice = instruction_choice
        videos = OpenVideos()
        self._readers = [EpisodeReader(d, config.size_px, videos) for d in selection.datasets]

    def __len__(self) -> int:
        return len(self.selection)

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Return the episode `number`."""
        entry = self.selection.entry(number)
        reader = self._readers[self.selection.dataset[number]]
        labelled = EXECUTED in reader.index.shapes
        every = self.config.every_frame or labelled
        more = (LABEL,) * every + (EXECUTED,) * labelled
        rows = reader.rows(entry, (*_ROWS, *more))
        poses = planar_poses(rows["observation.state"])
        if every:
            frames, actions = np.arange(entry.length), rows[LABEL][:, 0]
        else:
            divided = discrete_steps(poses)
            frames, actions = divided.frame, divided.action
            poses = poses[frames]
        count, steps = len(frames), min(len(frames), self.config.max_steps)
        executed = rows[EXECUTED][:, 0] if labelled else actions
        previous = np.concatenate([[0], 1 + executed[:-1]])
        changed = np.concatenate([[True], np.diff(actions) != 0])
        item: dict[str, Any] = {
            "tokens": torch.from_numpy(self.tokens.encode(self.instruction_choice.text(entry))),
            "action": _tensor(actions, steps),
            "previous_action": _tensor(previous, steps),
            "weight": _tensor(
                np.where(changed, np.float32(self.config.inflection_coefficient), np.float32(1)),
                steps,
            ),
            "progress": _tensor(rows["observation.progress"][frames, 0], steps),
            "motion": _tensor(motions(poses), steps),
            "pose": _tensor(relative(poses, 0).astype(np.float32), steps),
            "length": torch.tensor(steps),
            "cut": torch.tensor(steps < count),
            "uid": entry.uid,
            "robot": entry.robot,
        }
        if self.config.future:
            ahead = np.arange(count)[:, None] + np.arange(1, self.config.future + 1)
            item["waypoints"] = _tensor(future_poses(poses, self.config.future), steps)
            item["waypoint_valid"] = _tensor((ahead < count) & (not labelled), steps)
        if self.config.images:
            seen = frames[:steps]
            rgb, depth = reader.rgbd(entry, 0, int(seen[-1]) + 1)
            item["rgb"] = torch.from_numpy(rgb[seen]).permute(0, 3, 1, 2)
            item["depth"] = torch.from_numpy(depth[seen])[:, None]
        return item


def collate_sequences(items: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Pad episodes to the longest: (B, T, …), zeros behind each end.

    Adds `mask` (B, T), true where a step is real. Strings become lists.
    """
    lengths = torch.stack([item["length"] for item in items])
    steps = int(lengths.max())
    batch: dict[str, Any] = {}
    for key, first in items[0].items():
        values = [item[key] for item in items]
        if not torch.is_tensor(first):
            batch[key] = values
        elif key == "tokens" or first.ndim == 0:
            batch[key] = torch.stack(values)
        else:
            padded = first.new_zeros((len(items), steps, *first.shape[1:]))
            for row, value in zip(padded, values, strict=True):
                row[: len(value)] = value
            batch[key] = padded
    batch["mask"] = torch.arange(steps)[None] < lengths[:, None]
    return batch


def pack(batch: Mapping[str, torch.Tensor], key: str) -> PackedSequence:
    """Return one key (B, T, …) of a batch, packed for `torch.nn.GRU` and similar modules."""
    return pack_padded_sequence(
        batch[key], batch["length"].cpu(), batch_first=True, enforce_sorted=False
    )


def _tensor(values: NDArray[Any], steps: int) -> torch.Tensor:
    return torch.from_numpy(values[:steps].copy())
