"""Repair a scan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ....formats.core.errors import SceneError
from ....scene_repair.config import RepairConfig
from ...engine.work import ItemResult
from .outputs import write_scene


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
        from ....scene_repair.repair import repair_scene

        return write_scene(self.out, partial(repair_scene, self.source, config=self.config))


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
