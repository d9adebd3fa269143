"""Distinguish files of Gaussian splats from meshes and point clouds without reading them.

It imports no reader, so that the keys of mesh readers do not depend on them.
"""

from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

from ..core.errors import FileFormatError
from ..untrusted.documents import parse_json
from ..untrusted.files import check_input, open_input, read_input
from ..untrusted.glb import read_glb
from ..untrusted.limits import limits
from .ply_header import PlyHeader, read_ply_header

OWN_SUFFIXES = (".splat", ".spz")
SHARED_SUFFIXES = (".ply", ".glb", ".gltf")
USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
EXTENSION = "KHR_gaussian_splatting"
# One of these occurs in the bytes of a USD file with splats: the schemas of OpenUSD, or the file of
# 3DGRUT's NuRec volume.
USD_TELLING = (b"ParticleField", b".nurec")
# Any one of these says that splats are meant; meshes and point clouds have none of them.
TELLING = {"f_dc_0", "scale_0", "rot_0"}
PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
PLAIN, COMPRESSED = "PLY of 3D Gaussian splatting", "compressed PLY, as SuperSplat writes it"


def splat_kind(path: Path) -> str:
    """Return which kind of Gaussian splats a file holds; empty for anything else.

    A mesh with vertex colours or a point cloud is not one, whatever its attributes are called:
    splats need the extension in glTF, and in PLY their own properties and no faces.
    """
    suffix = path.suffix.lower()
    if suffix in OWN_SUFFIXES:
        return suffix
    if suffix == ".ply":
        return ply_splat_kind(read_ply_header(path))
    if suffix in SHARED_SUFFIXES and declares_splats(path):
        return "glTF with KHR_gaussian_splatting"
    if suffix in USD_SUFFIXES and _mentions(path, USD_TELLING):
        return "USD with Gaussian splats"
    return ""


def _mentions(path: Path, words: tuple[bytes, ...]) -> bool:
    """Return whether any of `words` occurs in a file."""
    if not check_input(path):
        return False
    with open_input(path) as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        return any(data.find(word) >= 0 for word in words)


def is_splats(path: Path) -> bool:
    """Return whether a file holds Gaussian splats; False for what cannot be read."""
    try:
        return bool(splat_kind(path))
    except (FileFormatError, OSError):
        return False


def ply_splat_kind(header: PlyHeader) -> str:
    """Return which kind of splats a PLY file holds; empty for meshes and point clouds."""
    vertex = header.elements.get("vertex")
    faces = header.elements.get("face")
    if vertex is None or (faces is not None and faces.count > 0):
        return ""
    names = set(vertex.properties)
    if set(PACKED) <= names:
        return COMPRESSED
    return PLAIN if len(TELLING & names) >= 2 else ""


def gltf_tree(path: Path) -> tuple[dict[str, Any], memoryview]:
    """Return the JSON tree and the binary chunk of a GLB or glTF file.

    Raises:
        ValueError: damaged, or beyond a limit.
    """
    try:
        if path.suffix.lower() == ".glb":
            text, body = read_glb(path)
        else:
            text = read_input(path, max_bytes=limits().json_bytes)
            body = memoryview(b"")
        tree = parse_json(path, text)
    except FileFormatError as error:
        raise ValueError(error.reason) from error
    if not isinstance(tree, dict):
        raise ValueError("not a JSON object")
    return tree, body


def declares_splats(path: Path) -> bool:
    """Return whether a GLB or glTF file names the extension; damaged files do not."""
    try:
        tree, _ = gltf_tree(path)
        used = tree.get("extensionsUsed", [])
        return isinstance(used, list) and EXTENSION in used and bool(splat_primitives(tree))
    except (FileFormatError, ValueError, OSError, TypeError, AttributeError):
        return False


def splat_primitives(tree: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the primitives of all meshes that are splats."""
    return [
        primitive
        for mesh in tree.get("meshes", [])
        for primitive in mesh.get("primitives", [])
        if EXTENSION in primitive.get("extensions", {})
    ]
