"""Repair a scan."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from ...formats.core.atomic import atomic_folder
from ...scene_repair.config import RepairConfig
from ..engine.work import ItemResult


@dataclass(frozen=True)
class RepairJob:
    """Turn one scan into a simulation-ready scene.

    Attributes:
        source: the scan.
        out: folder of the scene.
        config: how; names the scene.
    """

    source: Path
    out: Path
    config: RepairConfig

    def run(self) -> ItemResult:
        """Repair one scan."""
        # Mesh and USD libraries take seconds to import: only where the work is done.
        from ...scene_repair.repair import repair_scene

        with atomic_folder(self.out) as temporary:
            repair_scene(self.source, temporary, self.config)
            log = json.loads((temporary / "repair.json").read_text())
        levels = log["levels"]
        holes = [hole for level in levels for hole in level["holes"]]
        filled = [hole for hole in holes if hole["action"] == "filled"]
        left = Counter(hole["cause"] for hole in holes if hole["action"] != "filled")
        facts = {
            "levels": len(levels),
            "holes_filled": len(filled),
            "holes_left": dict(left),
            "floor_before_m2": sum(level["floor_area_before_m2"] for level in levels),
            "floor_after_m2": sum(level["floor_area_after_m2"] for level in levels),
            "triangles": log["triangles_after"],
            "warnings": log["warnings"],
        }
        return ItemResult(facts)
