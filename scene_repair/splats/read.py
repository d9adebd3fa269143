"""Read Gaussian splats as a scan: the surface fused from them, and the splats themselves."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.errors import FileFormatError, SceneError
from ...formats.splats.kind import USD_SUFFIXES, splat_kind
from ...formats.splats.read import read_splats
from ...formats.splats.record import GaussianCloud
from ...formats.splats.store import save_splats
from ..scan.dispatch import check_scan, read_scan
from ..scan.record import Scan, ScanMaterial
from ..scan.soup import Part, merge_parts
from .fuse import fuse_splats
from .occupancy import read_occupancy
from .solid import find_solid
from .usd import read_usd_splats

LEAST_FACES = 200
# Suffix of InteriorGS' map of free floor.
OCCUPANCY = ".png"


@dataclass(frozen=True)
class KeptSplats:
    """The splats of a scan, for rendering (a `Companion`).

    `surface` says where the surface comes from: `fused`, or the name of the user's file.
    """

    cloud: GaussianCloud
    surface: str

    def save(self, folder: Path, source_to_world: Array) -> dict[str, Any]:
        """Write the splats into a bundle's folder; `source_to_world` is for file coordinates."""
        save_splats(folder, self.cloud.transformed(source_to_world))
        return {"splats": {"count": len(self.cloud), "surface": self.surface}}


def read_splat_scan(
    path: Path, progress: Callable[[str], None], collision: Path | None = None
) -> Scan:
    """Read the splats of `path` and the surface that they show; report progress in short lines.

    `collision` is a mesh, USD stage or InteriorGS' `occupancy.png` in the same coordinates, which
    takes the place of the fused surface; None = fuse one.

    Raises:
        FileFormatError: damaged, or without a surface that can be seen from inside.
    """
    check_scan(path)
    kind = splat_kind(path)
    cloud = read_usd_splats(path) if path.suffix.lower() in USD_SUFFIXES else read_splats(path)
    if collision is not None:
        occupancy = collision.suffix.lower() == OCCUPANCY
        surface = read_occupancy(collision, cloud) if occupancy else read_scan(collision)
        notes = (*cloud.warnings, f"{len(cloud):,} Gaussians ({kind}); their surface is given")
        return replace(
            surface,
            licence=surface.licence or cloud.licence,
            warnings=(*notes, *surface.warnings),
            companion=KeptSplats(cloud, collision.name),
        )
    try:
        near = replace(cloud, offset=(0.0, 0.0, 0.0))
        solid = find_solid(near)
        mesh, color = fuse_splats(near, solid, progress)
    except SceneError as error:
        raise FileFormatError(path, str(error)) from error
    if len(mesh.faces) < LEAST_FACES:
        raise FileFormatError(path, f"no surface could be fused from its {len(cloud):,} Gaussians")
    warnings = [
        *cloud.warnings,
        f"surface of {len(mesh.faces):,} triangles fused from {int(solid.keep.sum()):,} of "
        f"{len(cloud):,} Gaussians ({kind}); {solid.floaters:,} floaters and "
        f"{solid.background:,} of a far background left out of physics",
    ]
    white = ScanMaterial("splats", (1.0, 1.0, 1.0))
    uv = np.zeros((len(mesh.faces), 3, 2), dtype=np.float32)
    part = Part(
        "splats", "", mesh.vertices + cloud.offset, mesh.faces, uv, white, color[mesh.faces]
    )
    scan = merge_parts([part], warnings, cloud.up, cloud.unit)
    return replace(scan, licence=cloud.licence, companion=KeptSplats(cloud, "fused"))
