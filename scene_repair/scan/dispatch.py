"""Read a scan of any file type; the suffix selects the reader."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from PIL import Image

from ...formats.core.errors import FileFormatError, InputError
from ...formats.splats.read import splat_kind
from ...formats.untrusted.files import check_input, is_text, read_input
from ...formats.untrusted.limits import limits
from ..splats.read import read_splat_scan
from ..usd.package import read_member
from .files import CLOUD_SUFFIXES, SUFFIXES, USD_SUFFIXES, why_not
from .headers import has_faces
from .images import PixelBudget, decode_all, open_image
from .mesh import read_mesh
from .readings import LookRef, Readings
from .record import Scan, ScanMaterial
from .resolver import MAX_BYTES
from .sandbox import read_in_child
from .soup import Part, merge_parts

log = logging.getLogger(__name__)


def read_scan(path: Path, surface: Path | None = None) -> Scan:
    """Read meshes, USD stages, point clouds and Gaussian splats into one triangle soup.

    Args:
        path: the file.
        surface: a mesh in the same coordinates, to take instead of the one fused from splats.

    Raises:
        FileFormatError: missing, damaged, of a kind that is not read, referring outside its folder,
            or without any usable triangle.
        InputError: a point cloud, and open3d is not installed; or a surface for what has its own.
    """
    check_input(path, max_bytes=limits().scan_bytes)
    if not is_text(path):
        raise FileFormatError(path, "its name, or that of a folder above, is not UTF-8; rename it")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileFormatError(path, why_not(path.name))
    if splat_kind(path):
        given = None if surface is None else read_scan(surface)
        scan, cloud = read_splat_scan(path, log.info, given)
        return replace(scan, splats=cloud)
    if surface is not None:
        raise InputError(
            f"--collision {surface}: {path.name} has a surface of its own; valid: Gaussian splats"
        )
    if suffix in USD_SUFFIXES:
        return scan_of(path, read_in_child("usd", path))
    if suffix in CLOUD_SUFFIXES or (suffix == ".ply" and not has_faces(path)):
        return scan_of(path, read_in_child("points", path))
    return read_mesh(path)


def scan_of(path: Path, readings: Readings) -> Scan:
    """Convert a reader's output to a scan and load the images that it refers to.

    Raises:
        FileFormatError: there is no usable triangle.
    """
    warnings = list(readings.warnings)
    materials = _materials(path.parent.resolve(), readings.looks, warnings)
    parts = [
        Part(p.name, p.category, p.vertices, p.faces, p.uv, materials[p.look], p.colors)
        for p in readings.parts
    ]
    if not parts:
        raise FileFormatError(path, "; ".join(["contains no visible triangles", *warnings[:3]]))
    scan = merge_parts(parts, warnings, readings.up, readings.unit)
    if not len(scan.faces):
        raise FileFormatError(path, "contains no usable triangle: " + "; ".join(warnings[:5]))
    return scan


def _materials(folder: Path, looks: list[LookRef], warnings: list[str]) -> list[ScanMaterial]:
    """Return materials with their images; each image is opened once."""
    opened: dict[str, Image.Image] = {}
    tried: set[str] = set()
    budget = PixelBudget()
    for look in looks:
        key = look.texture + look.member
        if look.texture and key not in tried:
            tried.add(key)
            image = _picture(folder, look, warnings, budget)
            if image is not None:
                opened[key] = image
    pictures = decode_all(opened, warnings)
    return [
        ScanMaterial(look.name, look.base_color, pictures.get(look.texture + look.member))
        for look in looks
    ]


def _picture(
    folder: Path, look: LookRef, warnings: list[str], budget: PixelBudget
) -> Image.Image | None:
    path = Path(look.texture).resolve()
    if not path.is_relative_to(folder):
        warnings.append(f"reference {look.texture!r} leaves the scan's folder; ignored")
        return None
    try:
        if look.member:
            data = read_member(path, look.member)
        else:
            data = read_input(path, root=folder, max_bytes=MAX_BYTES)
    except (OSError, FileFormatError) as error:
        warnings.append(f"picture {look.member or path.name} cannot be read: {error}")
        return None
    return open_image(data, look.member or path.name, warnings, budget)
