"""Repair a scan of Gaussian splats.

A module of its own: an edit of the rasteriser or the fusion repairs splats again, but no meshes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ....scene_repair.config import RepairConfig
from ...engine.work import ItemResult
from .outputs import write_scene


@dataclass(frozen=True)
class SplatRepairJob:
    """Turn one scan of Gaussian splats into a simulation-ready scene; see `RepairJob`."""

    source: Path
    out: Path
    config: RepairConfig

    def run(self) -> ItemResult:
        """Repair one scan."""
        # Takes seconds to import: only where the work is done.
        from ....scene_repair.splats.repair import repair_splats

        return write_scene(self.out, partial(repair_splats, self.source, config=self.config))
