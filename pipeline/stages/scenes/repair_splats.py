"""Repair a scan of Gaussian splats.

A module of its own: an edit of the rasteriser or the fusion repairs splats again, but no meshes.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ....scene_repair.config import RepairConfig
from ....scene_repair.scan.files import may_be_points
from ...engine.work import ItemResult
from .outputs import write_scene


@dataclass(frozen=True)
class SplatRepairJob:
    """Turn one scan of Gaussian splats into a simulation-ready scene; see `RepairJob`."""

    source: Path
    out: Path
    config: RepairConfig

    @property
    def unused_libraries(self) -> frozenset[str]:
        """Open3D and msgpack, unless the collision surface or the splats may need them."""
        points = self.config.collision and may_be_points(Path(self.config.collision))
        packed = self.source.suffix.lower() == ".usdz"
        unused = {"open3d": not points, "msgpack": not packed}
        return frozenset(name for name, without in unused.items() if without)

    def run(self) -> ItemResult:
        """Repair one scan."""
        # Takes seconds to import: only where the work is done.
        from ....scene_repair.splats.repair import repair_splats

        return write_scene(self.out, partial(repair_splats, self.source, config=self.config))
