"""Read Gaussian splats of any file format."""

from pathlib import Path

from ..core.errors import FileFormatError
from ..untrusted.files import check_input
from ..untrusted.limits import limits
from .gltf import read_gltf_splats
from .kind import OWN_SUFFIXES, SHARED_SUFFIXES
from .packed import read_dot_splat, read_spz
from .ply import read_ply_splats
from .record import GaussianCloud


def read_splats(path: Path) -> GaussianCloud:
    """Read Gaussian splats: PLY, compressed PLY, `.splat`, SPZ or glTF."""
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
