"""glTF with `KHR_gaussian_splatting`: points whose attributes are splats.

Layout: the Khronos extension's specification: activated opacities, linear scales, quaternions in
xyzw order. Older drafts had `_SCALE`, `_ROTATION` and `COLOR_0` instead; these are not read.
"""

import base64
import binascii
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..core.arrays import F32
from ..core.errors import FileFormatError
from ..core.frames import quat_to_matrix
from ..untrusted.files import PARSER_ERRORS, read_input
from ..untrusted.limits import limits
from .kind import EXTENSION, gltf_tree, splat_primitives
from .packed import spz_cloud, spz_header
from .record import GaussianCloud, check_count, cleaned, joined

_SPZ = "KHR_gaussian_splatting_compression_spz"
SPZ_EXTENSIONS = (f"{_SPZ}_2", _SPZ)
POINTS = 0
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
UP = ("y", "glTF is y up by its specification")
UNIT = ("m", "glTF is in metres by its specification")
MAX_NODES, MAX_DEPTH = 10_000, 64


def read_gltf_splats(path: Path) -> GaussianCloud:
    """Read all splats of a GLB or glTF file, each moved as its node says."""
    try:
        tree, body = gltf_tree(path)
        reader = _Reader(path, tree, body)
        primitives = splat_primitives(tree)
        total = sum(len(mesh.get("primitives", [])) for mesh in tree.get("meshes", []))
        if len(primitives) < total:
            raise FileFormatError(
                path, "contains both meshes and Gaussian splats; export them to separate files"
            )
        placed = [
            (primitive, matrix)
            for mesh, matrix in _placed(tree)
            for primitive in tree["meshes"][mesh]["primitives"]
        ]
        if not placed:
            raise FileFormatError(path, "contains no Gaussian splats in its scene")
        # Nodes that show one mesh many times cost a file nothing: all are counted before any is
        # read.
        sizes = [reader.size(primitive) for primitive, _ in placed]
        check_count(path, sum(n for n, _ in sizes), max(degree for _, degree in sizes))
        clouds = [reader.cloud(part).transformed(matrix, far=True) for part, matrix in placed]
    except PARSER_ERRORS as error:
        raise FileFormatError(path, f"damaged glTF of Gaussian splats: {error!r}") from error
    return cleaned(path, replace(joined(clouds), up=UP, unit=UNIT))


def _placed(tree: dict[str, Any]) -> list[tuple[int, np.ndarray]]:
    """Return the mesh and the transform (4, 4) to the scene of every node with a mesh."""
    nodes = tree.get("nodes", [])
    if not tree.get("scenes"):
        children = {c for node in nodes for c in node.get("children", [])}
        roots = [k for k in range(len(nodes)) if k not in children]
    else:
        roots = tree["scenes"][tree.get("scene", 0)].get("nodes", [])
    placed, seen = [], 0
    stack = [(k, np.eye(4), 0) for k in roots]
    while stack:
        k, parent, depth = stack.pop()
        seen += 1
        if seen > MAX_NODES or depth > MAX_DEPTH:
            raise ValueError(f"more than {MAX_NODES} nodes, or deeper than {MAX_DEPTH}")
        node = nodes[k]
        matrix = parent @ _local(node)
        if "mesh" in node:
            placed.append((node["mesh"], matrix))
        stack += [(c, matrix, depth + 1) for c in node.get("children", [])]
    return placed


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    if np.ptp(scale) > 1e-6 * np.abs(scale).max() or scale.min() <= 0:
        raise ValueError(f"splats scaled by {scale.tolist()}; valid: one positive factor")
    matrix[:3, :3] = quat_to_matrix((w, x, y, z)) * scale
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


class _Reader:
    def __init__(self, path: Path, tree: dict[str, Any], body: memoryview):
        self._path, self._tree, self._body = path, tree, body
        self._buffers: dict[int, memoryview] = {}

    def size(self, primitive: dict[str, Any]) -> tuple[int, int]:
        """Return the number of splats of a primitive, and the degree of their harmonics."""
        if (packed := self._spz(primitive)) is not None:
            head = spz_header(self._path, packed)
            return struct.unpack_from("<I", head, 8)[0], head[12]
        attributes, degree = primitive["attributes"], 0
        while f"{EXTENSION}:SH_DEGREE_{degree + 1}_COEF_0" in attributes:
            degree += 1
        return int(self._tree["accessors"][attributes["POSITION"]]["count"]), degree

    def _spz(self, primitive: dict[str, Any]) -> memoryview | None:
        inner = primitive["extensions"][EXTENSION].get("extensions", {})
        views = [inner[name]["bufferView"] for name in SPZ_EXTENSIONS if name in inner]
        return self._view(views[0]) if views else None

    def cloud(self, primitive: dict[str, Any]) -> GaussianCloud:
        """Return the splats of a primitive in its own frame."""
        if primitive.get("mode", 4) != POINTS:
            raise ValueError(f"splats of mode {primitive.get('mode', 4)}; valid: {POINTS} (points)")
        if (packed := self._spz(primitive)) is not None:
            return spz_cloud(self._path, bytes(packed))
        extension = primitive["extensions"][EXTENSION]
        inner = extension.get("extensions", {})
        if inner or extension.get("kernel", "ellipse") != "ellipse":
            kind = ", ".join(inner) or extension["kernel"]
            raise FileFormatError(self._path, f"Gaussian splats with {kind} are not read")
        attributes = primitive["attributes"]
        position = self._accessor(attributes["POSITION"])

        def attribute(name: str) -> F32:
            values = self._accessor(attributes[f"{EXTENSION}:{name}"])
            if len(values) != len(position):
                raise ValueError(f"{name} has {len(values)} rows for {len(position)} Gaussians")
            return values

        degree = self.size(primitive)[1]
        terms = [
            attribute(f"SH_DEGREE_{band}_COEF_{k}")
            for band in range(degree + 1)
            for k in range(2 * band + 1)
        ]
        return GaussianCloud(
            position=position,
            scale=attribute("SCALE"),
            quat_wxyz=np.roll(attribute("ROTATION"), 1, axis=1),
            opacity=attribute("OPACITY")[:, 0],
            harmonics=np.stack(terms, axis=1),
        )

    def _accessor(self, index: int) -> F32:
        """Return the rows (N, width) of an accessor; integers only if normalised."""
        entry = self._tree["accessors"][index]
        kind, width = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]]
        count, skip = int(entry["count"]), int(entry.get("byteOffset", 0))
        if "sparse" in entry or (kind.kind != "f" and not entry.get("normalized")):
            raise ValueError(f"accessor {index} is sparse or of plain integers")
        check_count(self._path, count, 0)
        data = self._view(entry["bufferView"])
        step = int(self._tree["bufferViews"][entry["bufferView"]].get("byteStride", 0))
        step = step or kind.itemsize * width
        last = skip + (count - 1) * step + kind.itemsize * width
        if skip < 0 or step < kind.itemsize * width or last > len(data):
            raise ValueError(f"accessor {index} needs {last:,} of {len(data):,} bytes")
        rows = np.ndarray((count, width), kind, data, skip, (step, kind.itemsize))
        if kind.kind == "f":
            return rows.astype(np.float32)
        return np.maximum(rows.astype(np.float32) / np.iinfo(kind).max, -1)

    def _view(self, index: int) -> memoryview:
        view = self._tree["bufferViews"][index]
        data = self._buffer(int(view["buffer"]))
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or length < 0 or start + length > len(data):
            raise ValueError(f"buffer view {index} extends beyond its buffer")
        return data[start : start + length]

    def _buffer(self, index: int) -> memoryview:
        if index not in self._buffers:
            uri = self._tree["buffers"][index].get("uri")
            self._buffers[index] = self._body if uri is None else self._load(str(uri))
        return self._buffers[index]

    def _load(self, uri: str) -> memoryview:
        if uri.startswith("data:"):
            try:
                return memoryview(base64.b64decode(uri.partition(",")[2], validate=True))
            except binascii.Error as error:
                raise ValueError(f"embedded data is not valid base64: {error}") from error
        folder = self._path.parent.resolve()
        target = (folder / unquote(uri)).resolve()
        return memoryview(read_input(target, root=folder, max_bytes=limits().scan_bytes))
