"""Write instructions for episodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...formats.vlnce.files import read_episodes, write_episodes
from ...instruction_gen.instruct import instruct_episodes
from ...instruction_gen.records import InstructConfig
from ..engine.work import ItemResult


@dataclass(frozen=True)
class InstructJob:
    """Write instructions for the episodes of one file that have none.

    Attributes:
        scenes: folder of the repaired scenes.
        episodes: episode file.
        out: episode file.
        config: how.
        seed: of the phrasing.
    """

    scenes: Path
    episodes: Path
    out: Path
    config: InstructConfig
    seed: int

    def run(self) -> ItemResult:
        """Instruct one file's episodes."""
        asked = read_episodes(self.episodes)
        rng = np.random.default_rng(self.seed)
        told = instruct_episodes(asked, self.scenes, self.config, rng)
        write_episodes(self.out, told.episodes)
        return ItemResult({"episodes": len(told.episodes), "problems": told.problems})
