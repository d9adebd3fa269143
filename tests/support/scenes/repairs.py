"""Repair small scans for tests."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import trimesh

from tests.support.machine import once
from tests.support.scenes import scans
from tests.support.scenes.stair_halls import StairHall, stair_hall
from vlnpe.formats.scene.bundle import SceneBundle, load_bundle
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


def repaired_hall(
    factory: pytest.TempPathFactory, shape: str, *measures_m: float
) -> tuple[StairHall, SceneBundle]:
    """Return a `stair_hall` and its repaired scene, which all tests share and only read."""
    hall = stair_hall(shape, *measures_m)
    name = "-".join(["hall", shape, *map(str, measures_m)])
    folder = once(factory, name, lambda folder: repaired(hall.parts, folder))
    return hall, load_bundle(folder / "bundle")
