"""Episodes that a policy walked and an expert corrected (DAgger; Ross et al., 2011)."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from ...datasets.poses import motions
from ...datasets.tokens import Tokens
from ...formats.core.arrays import F32, I64, U8, Array
from ...formats.core.atomic import atomic_file
from ...formats.core.errors import FileFormatError
from ..config import TrainConfig
from ..images import DEPTH_STEP_M, to_millimetres
from ..models.heads import FUTURE


@dataclass(frozen=True)
class Correction:
    """One walk of T steps.

    Attributes:
        rgb: (T, 3, S, S) uint8, as the model got them.
        depth_m: (T, 1, S, S) float32.
        action: (T,) the expert's action at each step.
        executed: (T,) the action that was taken.
        pose: (T, 3) x, y [m], yaw [rad] relative to the first step.
        progress: (T,) 0 … 1 of the expert's route.
        name: name of the episode.
    """

    rgb: U8
    depth_m: F32
    action: I64
    executed: I64
    pose: Array
    progress: F32
    instruction: str
    name: str
    robot: str


def write_correction(path: Path, walk: Correction) -> None:
    """Write one walk."""
    values = {key: value for key, value in vars(walk).items() if key != "depth_m"}
    with atomic_file(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, depth_mm=to_millimetres(walk.depth_m), **values)


class CorrectedEpisodes(Dataset[dict[str, Any]]):
    """Corrected walks as items of `EpisodeSequences`, but without waypoints.

    Attributes:
        digest: digest of all files.
    """

    def __init__(self, files: Sequence[Path], tokens: Tokens, config: TrainConfig):
        """Read the files' digests; the walks are read later."""
        self._files, self._tokens, self._config = list(files), tokens, config
        state = hashlib.blake2b(digest_size=12)
        for path in self._files:
            state.update(path.read_bytes())
        self.digest = state.hexdigest()

    def __len__(self) -> int:
        return len(self._files)

    def begin_pass(self, epoch: int) -> None:
        """Do nothing: a walk has the instruction that the policy was given."""

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Walk `number`.

        Raises:
            FileFormatError: the file is damaged.
        """
        path = self._files[number]
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
            steps = min(len(arrays["action"]), self._config.max_steps)
            return self._item(arrays, steps)
        except (OSError, ValueError, KeyError) as error:
            raise FileFormatError(path, f"not a corrected walk ({error})") from error

    def _item(self, arrays: dict[str, NDArray[Any]], steps: int) -> dict[str, Any]:
        action, executed = arrays["action"], arrays["executed"]
        changed = np.concatenate([[True], action[1:] != executed[:-1]])
        inflection = np.float32(self._config.inflection)
        values: dict[str, NDArray[Any]] = {
            "rgb": arrays["rgb"],
            "depth": arrays["depth_mm"].astype(np.float32) * np.float32(DEPTH_STEP_M),
            "action": action,
            "previous_action": np.concatenate([[0], 1 + executed[:-1]]),
            "weight": np.where(changed, inflection, np.float32(1)),
            "progress": arrays["progress"],
            "motion": motions(arrays["pose"]),
            "pose": arrays["pose"].astype(np.float32),
            "waypoints": np.zeros((len(action), FUTURE, 3), np.float32),
            "waypoint_valid": np.zeros((len(action), FUTURE), bool),
        }
        item: dict[str, Any] = {k: torch.from_numpy(v[:steps].copy()) for k, v in values.items()}
        return item | {
            "tokens": torch.from_numpy(self._tokens.encode(str(arrays["instruction"]))),
            "length": torch.tensor(steps),
            "cut": torch.tensor(int(action[steps - 1]) != 0),
            "uid": str(arrays["name"]),
            "robot": str(arrays["robot"]),
        }
