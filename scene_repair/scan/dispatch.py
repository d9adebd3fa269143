"""Read a scan of any file type but splats; the suffix selects the reader.

Splats are only recognised here: an edit of what fuses them must not repair meshes again.
"""

from dataclasses import replace
from pathlib import Path
from typing import cast

from PIL import Image

from ...formats.core.errors import FileFormatError
from ...formats.splats.kind import splat_kind
from ...formats.untrusted.files import check_input, is_text, read_input
from ...formats.untrusted.limits import limits
from ..usd.package import read_member
from .files import CLOUD_SUFFIXES, SUFFIXES, USD_SUFFIXES, why_not
from .headers import has_faces
from .images import PixelBudget, decode_all, open_image
from .mesh import read_mesh
from .readings import LookRef, Readings
from .record import Scan, ScanMaterial
from .resolver import MAX_BYTES
from .sandbox import read_in_child
from .soup import ScanPart, merge_parts


def read_scan(path: Path) -> Scan:
    """Read meshes, USD stages and point clouds into one triangle soup.

    Raises:
        FileFormatError: missing, damaged, of a kind that is not read, referring outside its folder,
            without any usable triangle, or Gaussian splats, which `splats.read` reads.
        InputError: a point cloud, and open3d is not installed.
    """
    check_scan(path)
    suffix = path.suffix.lower()
    # Beside splats a USD stage may hold the mesh that is wanted.
    if suffix not in USD_SUFFIXES and (kind := splat_kind(path)):
        raise FileFormatError(path, f"contains Gaussian splats ({kind}), not a mesh or point cloud")
    if suffix in USD_SUFFIXES:
        return scan_of(path, read_in_child("usd", path))
    if suffix in CLOUD_SUFFIXES or (suffix == ".ply" and not has_faces(path)):
        return scan_of(path, read_in_child("points", path))
    return read_mesh(path)


def check_scan(path: Path) -> None:
    """Raise FileFormatError unless `path` is an existing file of a kind that is read."""
    check_input(path, max_bytes=limits().scan_bytes)
    if not is_text(path):
        raise FileFormatError(path, "its name, or that of a folder above, is not UTF-8; rename it")
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(path, why_not(path.name))


def scan_of(path: Path, readings: Readings) -> Scan:
    """Convert a reader's output to a scan; raise FileFormatError if no triangle is usable."""
    warnings = list(readings.warnings)
    refs = list(dict.fromkeys(part.material for part in readings.parts))
    materials = dict(zip(refs, _materials(path.parent.resolve(), refs, warnings), strict=True))
    parts = [
        cast(ScanPart, replace(part, material=materials[part.material]))  # type: ignore[arg-type]
        for part in readings.parts
    ]
    if not parts:
        raise FileFormatError(path, "; ".join(["contains no visible triangles", *warnings[:3]]))
    scan = merge_parts(parts, warnings, readings.up, readings.unit)
    if not len(scan.faces):
        raise FileFormatError(path, "contains no usable triangle: " + "; ".join(warnings[:5]))
    return scan


def _materials(folder: Path, refs: list[LookRef], warnings: list[str]) -> list[ScanMaterial]:
    """Return materials with their images; each image is opened once."""
    opened: dict[str, Image.Image] = {}
    tried: set[str] = set()
    budget = PixelBudget()
    for look in refs:
        key = look.texture + look.member
        if look.texture and key not in tried:
            tried.add(key)
            image = _picture(folder, look, warnings, budget)
            if image is not None:
                opened[key] = image
    pictures = decode_all(opened, warnings)
    return [
        ScanMaterial(look.name, look.base_color, pictures.get(look.texture + look.member))
        for look in refs
    ]


def _picture(
    folder: Path, look: LookRef, warnings: list[str], budget: PixelBudget
) -> Image.Image | None:
    path = Path(look.texture).resolve()
    if not path.is_relative_to(folder):
        warnings.append(f"reference {look.texture!r} leads out of the scan's folder; ignored")
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
