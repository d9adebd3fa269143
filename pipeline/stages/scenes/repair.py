"""Repair a scan."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ....scene_repair.config import RepairConfig
from ....scene_repair.scan.files import may_be_points
from ...engine.work import ItemResult
from .outputs import write_scene


@dataclass(frozen=True)
class RepairJob:
    """Turn one scan into a simulation-ready scene."""

    source: Path
    out: Path
    config: RepairConfig

    @property
    def unused_libraries(self) -> frozenset[str]:
        """Open3D, unless the scan may be a point cloud."""
        return frozenset() if may_be_points(self.source) else frozenset({"open3d"})

    def run(self) -> ItemResult:
        """Repair one scan."""
        # Mesh and USD libraries take seconds to import: only where the work is done.
        from ....scene_repair.repair import repair_scene

        return write_scene(self.out, partial(repair_scene, self.source, config=self.config))
