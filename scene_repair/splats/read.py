"""Read Gaussian splats as a scan: the surface fused from them, and the splats themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...formats.core.errors import FileFormatError, SceneError
from ...formats.splats.read import read_splats, splat_kind
from ...formats.splats.record import GaussianCloud
from ..scan.record import Scan, ScanMaterial
from ..scan.soup import Part, merge_parts
from .fuse import fuse_splats
from .solid import find_solid

LEAST_FACES = 200


def read_splat_scan(
    path: Path, tell: Callable[[str], None], surface: Scan | None = None
) -> tuple[Scan, GaussianCloud]:
    """Read the splats of `path` and the surface that they show.

    Args:
        path: the file.
        tell: called with one short line before each step.
        surface: a surface in the same coordinates, which takes the place of the fused one.

    Raises:
        FileFormatError: damaged, or no surface that cameras could look at from inside.
    """
    cloud = read_splats(path)
    kind = splat_kind(path)
    if surface is not None:
        notes = (*cloud.warnings, f"{len(cloud):,} Gaussians ({kind}); their surface is given")
        licence = surface.licence or cloud.licence
        return replace(surface, licence=licence, warnings=(*notes, *surface.warnings)), cloud
    try:
        solid = find_solid(cloud)
        mesh, color = fuse_splats(cloud, solid, tell)
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
    part = Part("splats", "", mesh.vertices, mesh.faces, uv, white, color[mesh.faces])
    scan = merge_parts([part], warnings, cloud.up, cloud.unit)
    return replace(scan, licence=cloud.licence), cloud
