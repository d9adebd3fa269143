"""Repair a scan."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...formats.core.atomic import atomic_folder
from ...formats.core.errors import SceneError
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
        return ItemResult(facts_of(log))


@dataclass(frozen=True)
class SoundnessJob:
    """Accept or refuse a repaired scene.

    Attributes:
        scene_id: its name.
        problems: what is wrong with it.
        allow_unsound: let it pass all the same.
    """

    scene_id: str
    problems: tuple[str, ...]
    allow_unsound: bool

    def run(self) -> ItemResult:
        """Check one scene.

        Raises:
            SceneError: it is not sound, and may not be.
        """
        if self.problems and not self.allow_unsound:
            raise SceneError(
                f"{self.scene_id} is not sound: {'; '.join(self.problems)}. Look at after.png and "
                "repair.json in its folder; pass --allow-unsound to collect in it anyway"
            )
        return ItemResult({"problems": list(self.problems)})


def facts_of(log: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of a repair for ledger, terminal and report; `log` is its repair.json."""
    levels = log["levels"]
    holes = [hole for level in levels for hole in level["holes"]]
    filled = [hole for hole in holes if hole["action"] == "filled"]
    left = Counter(hole["cause"] for hole in holes if hole["action"] != "filled")
    source, proof = log["source"], log["verification"]
    return {
        **{key: source[key] for key in ("up", "up_reason", "unit", "unit_reason")},
        "sound": proof["sound"],
        "problems": proof["problems"],
        "doubts": log["doubts"] + proof["doubts"],
        "levels": len(levels),
        "floor_z_m": [level["floor_z_m"] for level in levels],
        "holes_filled": len(filled),
        "holes_left": dict(left),
        "floor_before_m2": sum(level["floor_area_before_m2"] for level in levels),
        "floor_after_m2": sum(level["floor_area_after_m2"] for level in levels),
        "triangles": log["triangles_after"],
        "warnings": log["warnings"],
    }
