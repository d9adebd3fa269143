"""Repair a scan of Gaussian splats.

A module of its own: an edit of the rasteriser or the fusion repairs splats again, but no meshes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ...scene_repair.config import RepairConfig
from ..engine.work import ItemResult
from .repair import facts_of


@dataclass(frozen=True)
class SplatRepairJob:
    """Turn one scan of Gaussian splats into a simulation-ready scene; see `RepairJob`."""

    source: Path
    out: Path
    config: RepairConfig

    def run(self) -> ItemResult:
        """Repair one scan."""
        # Takes seconds to import: only where the work is done.
        from ...scene_repair.splats.repair import repair_splats

        with atomic_folder(self.out) as temporary:
            repair_splats(self.source, temporary, self.config)
            log = json.loads((temporary / "repair.json").read_text())
        return ItemResult(facts_of(log))
