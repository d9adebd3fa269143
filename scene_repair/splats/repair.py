"""Repair a scan of Gaussian splats into a simulation-ready scene."""

from collections.abc import Callable
from pathlib import Path

from ...formats.scene.bundle import SceneBundle
from ..config import RepairConfig
from ..repair import repair_scene
from ..scan.record import Scan
from .read import read_splat_scan


def repair_splats(source: Path, out_dir: Path, config: RepairConfig | None = None) -> SceneBundle:
    """Write the repaired scene of the splats `source`, them included; see `repair_scene`."""
    return repair_scene(source, out_dir, config, read=_read)


def _read(source: Path, config: RepairConfig, progress: Callable[[str], None]) -> Scan:
    progress(f"reading {source.name}")
    return read_splat_scan(source, progress, Path(config.collision) if config.collision else None)
