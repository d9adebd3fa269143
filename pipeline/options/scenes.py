"""Options of the commands that make scenes: `scan`, `repair`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from .shared import Orientation, Printing


@dataclass(frozen=True)
class Scan(Printing):
    """Generate a furnished building and a virtual scan of it."""

    seed: tyro.conf.Positional[int] = 0
    """Random seed of the building; the same seed gives the same building."""
    kind: str = "apartment"
    """Kind of building: apartment, villa, house (two storeys) or office."""
    exact: bool = False
    """Write the building's exact, textured geometry instead of a virtual scan: no noise, no holes,
    no baked light, and a tenth of the time."""
    splats: bool = False
    """Capture the building as Gaussian splats (scan.ply) instead of a textured mesh (scan.glb)."""
    out: Path = Path("scan")
    """Output folder for the scan, its labels and the ground-truth floor."""


@dataclass(frozen=True)
class Repair(Orientation, Printing):
    """Turn a scan into a simulation-ready scene: fill floor holes and build collision geometry."""

    scan: tyro.conf.Positional[Path]
    """Scan to repair: GLB, glTF, OBJ, PLY, STL, USD, a point cloud (PLY, PCD), or Gaussian splats
    (PLY, SPLAT, SPZ, glTF). See docs/guides/scans.md for details and for label files."""
    out: Path = Path("scene")
    """Output folder for the scene."""
    collision: Path | None = None
    """Mesh, USD stage or InteriorGS' occupancy.png to use as the surface of splats; without it
    the surface is fused from them. It must be in the coordinates of the splats."""
    allow_unsound: bool = False
    """Exit with code 0 even if the repaired scene fails its soundness checks."""
