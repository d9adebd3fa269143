"""Selected episodes of one or several datasets, for loaders."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..formats.core.errors import InputError
from .episode_index import DatasetIndex, EpisodeEntry, read_index

# What tells recordings apart, besides the size of their images.
RECORDING = ("episode_uid", "robot", "controller", "light", "camera_name")
# What a digest of episodes holds: also how they ended, and their texts.
_IDENTITY = (*RECORDING, "end_reason", "instructions")


@dataclass(frozen=True)
class Selection:
    """Episodes in a fixed order.

    Attributes:
        dataset: (N,) which dataset each lies in.
        row: (N,) its row there.
    """

    datasets: tuple[DatasetIndex, ...]
    dataset: NDArray[np.int32]
    row: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.row)

    def index(self, number: int) -> DatasetIndex:
        """Return the dataset of an episode."""
        return self.datasets[self.dataset[number]]

    def entry(self, number: int) -> EpisodeEntry:
        """Return an episode."""
        return self.index(number).entry(int(self.row[number]))

    @cached_property
    def lengths(self) -> NDArray[np.int64]:
        """(N,) number of frames of each episode."""
        result = np.zeros(len(self), np.int64)
        for number, index in enumerate(self.datasets):
            here = self.dataset == number
            result[here] = index.table["length"].to_numpy()[self.row[here]]
        return result

    def labels(self, name: str) -> NDArray[np.object_]:
        """Return (N,) a label of each episode, e.g. `robot`."""
        result = np.empty(len(self), object)
        for number, index in enumerate(self.datasets):
            here = self.dataset == number
            result[here] = np.array([*index.labels(name), None], object)[:-1][self.row[here]]
        return result

    def trajectories(self) -> NDArray[np.object_]:
        """Return (N,) `scene/trajectory` of each episode."""
        return self.labels("scene_id") + "/" + self.labels("trajectory_id")

    @cached_property
    def frames(self) -> int:
        """Frames of all episodes."""
        return int(self.lengths.sum())

    def place_of_frame(self, number: int) -> tuple[int, int]:
        """Return the episode and frame in it of frame `number`, counted through all episodes.

        Raises:
            IndexError: there is no such frame.
        """
        if not 0 <= number < self.frames:
            raise IndexError(number)
        episode = int(np.searchsorted(self._ends, number, side="right"))
        return episode, number - int(self._ends[episode] - self.lengths[episode])

    @cached_property
    def _ends(self) -> NDArray[np.int64]:
        return np.cumsum(self.lengths)

    @cached_property
    def digest(self) -> str:
        """Digest of the episodes in order: names, labels, lengths, instructions."""
        columns = [self.labels(name).tolist() for name in _IDENTITY]
        facts = json.dumps([*columns, self.lengths.tolist()])
        return hashlib.blake2b(facts.encode(), digest_size=12).hexdigest()

    def take(self, mask: NDArray[np.bool_]) -> "Selection":
        """Return the episodes of `mask` (N,)."""
        return Selection(self.datasets, self.dataset[mask], self.row[mask])


def joined_digest(selections: Iterable[Selection]) -> str:
    """Return the digest of several selections, in order."""
    return "-".join(selection.digest for selection in selections)


def select_all(datasets: Iterable[DatasetIndex | Path]) -> Selection:
    """Return all episodes of `datasets`, one after another.

    Raises:
        FileFormatError: a folder holds no dataset collected by vlnpe.
    """
    indices = tuple(d if isinstance(d, DatasetIndex) else read_index(d) for d in datasets)
    counts = [len(index) for index in indices]
    return Selection(
        indices,
        np.repeat(np.arange(len(indices)), counts).astype(np.int32),
        np.concatenate([np.zeros(0), *(np.arange(n) for n in counts)]).astype(np.int32),
    )


def common_columns(datasets: Sequence[DatasetIndex]) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return the features that all datasets have in one type and shape, which can be batched.

    Joints and feet differ between robots, so only datasets of one robot have them in common.
    """
    if not datasets:
        return {}
    first, *others = datasets
    return {
        key: shape
        for key, shape in first.shapes.items()
        if all(other.shapes.get(key) == shape for other in others)
    }


def check_frame_rate(datasets: Iterable[DatasetIndex]) -> int:
    """Return the datasets' frame rate.

    Raises:
        InputError: they differ, or there is none.
    """
    rates = sorted({index.frames_per_second for index in datasets})
    if len(rates) != 1:
        raise InputError(
            f"the datasets have different frame rates ({rates} frames/s); valid: one rate"
        )
    return rates[0]
