"""Whole episodes decoded once, at the size they are trained with, and kept on disk."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.data import Dataset

from ...datasets.sequences import EpisodeSequences
from ...formats.core.atomic import atomic_file

_DEPTH_STEP_M = 0.001  # depth is kept in whole millimetres


class CachedSequences(Dataset[dict[str, Any]]):
    """Items of `EpisodeSequences`, each decoded once; memory stays flat, disk holds the images.

    Each training epoch would otherwise decode every video again, which takes longer than training.
    """

    def __init__(self, sequences: EpisodeSequences, folder: Path):
        """Keep the images of `sequences` in `folder`, which is created if missing."""
        self.sequences, self.folder = sequences, folder
        self._rows = EpisodeSequences(
            sequences.selection,
            sequences.tokens,
            replace(sequences.config, images=False),
        )
        self._rows.instruction_choice = sequences.instruction_choice
        folder.mkdir(parents=True, exist_ok=True)

    @property
    def digest(self) -> str:
        """Digest of the episodes."""
        return self.sequences.selection.digest

    def begin_pass(self, epoch: int) -> None:
        """Draw other instructions from the next item on, where paths have several."""
        self._rows.instruction_choice = replace(self.sequences.instruction_choice, epoch=epoch)

    def __len__(self) -> int:
        return len(self.sequences)

    def __getitem__(self, number: int) -> dict[str, Any]:
        """Episode `number`."""
        item = self._rows[number]
        with np.load(self.prepare(number), allow_pickle=False) as images:
            rgb, millimetres = images["rgb"], images["depth"]
        item["rgb"] = torch.from_numpy(rgb)
        item["depth"] = torch.from_numpy(millimetres.astype(np.float32) * _DEPTH_STEP_M)
        return item

    def prepare(self, number: int) -> Path:
        """Decode episode `number` unless that is done; return its file."""
        path = self.folder / f"{self._key(number)}.npz"
        if not path.is_file():
            item = self.sequences[number]
            depth = np.rint(item["depth"].numpy() / _DEPTH_STEP_M).clip(0, 65535)
            with atomic_file(path) as temporary, temporary.open("wb") as stream:
                np.savez(stream, rgb=item["rgb"].numpy(), depth=depth.astype(np.uint16))
        return path

    def _key(self, number: int) -> str:
        """Return a key of the episode's place, its files and the images' size."""
        entry = self.sequences.selection.entry(number)
        config = self.sequences.config
        parts: list[Any] = [entry.uid, entry.length, config.size_px, config.max_steps]
        parts.append(config.every_frame)
        for path in [entry.rows, *(place.path for place in entry.videos.values())]:
            facts = path.stat()
            parts += [path.resolve(), entry.first_frame, facts.st_size, facts.st_mtime_ns]
        return hashlib.blake2b(repr(parts).encode(), digest_size=12).hexdigest()
