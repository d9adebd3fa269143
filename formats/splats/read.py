"""Recognise and read Gaussian splats of any file format."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import FileFormatError
from ..untrusted.files import check_input
from ..untrusted.limits import limits
from .gltf import declares_splats, read_gltf_splats
from .packed import read_dot_splat, read_spz
from .ply import ply_splat_kind, read_ply_splats
from .ply_header import read_ply_header
from .record import GaussianCloud

OWN_SUFFIXES = (".splat", ".spz")
SHARED_SUFFIXES = (".ply", ".glb", ".gltf")


def splat_kind(path: Path) -> str:
    """Return which kind of Gaussian splats a file holds; empty for anything else.

    A mesh with vertex colours or a point cloud is none, whatever its attributes are called: splats
    need the extension in glTF, and in PLY their own properties and no faces.

    Raises:
        FileFormatError: a `.ply` without a header.
    """
    suffix = path.suffix.lower()
    if suffix in OWN_SUFFIXES:
        return suffix
    if suffix == ".ply":
        return ply_splat_kind(read_ply_header(path))
    if suffix in SHARED_SUFFIXES and declares_splats(path):
        return "glTF with KHR_gaussian_splatting"
    return ""


def read_splats(path: Path) -> GaussianCloud:
    """Read Gaussian splats: PLY, compressed PLY, `.splat`, SPZ or glTF.

    Raises:
        FileFormatError: missing, of another kind, or damaged.
    """
    check_input(path, max_bytes=limits().scan_bytes)
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return read_ply_splats(path)
    if suffix == ".splat":
        return read_dot_splat(path)
    if suffix == ".spz":
        return read_spz(path)
    if suffix in SHARED_SUFFIXES:
        return read_gltf_splats(path)
    valid = ", ".join((*OWN_SUFFIXES, *SHARED_SUFFIXES))
    raise FileFormatError(path, f"unknown type of splats {suffix!r}; valid: {valid}")
