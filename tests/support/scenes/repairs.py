"""Repair small scans for tests."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import trimesh

from tests.support.scenes import scans
from vlnpe.formats.scene.bundle import SceneBundle
from vlnpe.scene_repair.config import RepairConfig
from vlnpe.scene_repair.repair import repair_scene


def repaired(scan: Path | Sequence[trimesh.Trimesh], folder: Path, **options: Any) -> SceneBundle:
    """Return the bundle of a file, or of parts in the world frame, repaired into `folder`/bundle.

    Pictures are small: drawing them takes longer than repairing a room.
    """
    options.setdefault("picture_px", 200)
    source = scan if isinstance(scan, Path) else scans.write_glb(scan, folder / "scan.glb")
    (folder / "bundle").mkdir()
    return repair_scene(source, folder / "bundle", RepairConfig(**options))
