"""Check sizes, references and features of a glTF file before a library relies on them."""

from pathlib import Path
from typing import Any

from ...formats.core.errors import FileFormatError
from .file import GltfFile

COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MAX_TRIANGLES, MAX_NODES, MAX_DEPTH = 20_000_000, 50_000, 500
# Accessors without data are zeros, as many as they say; all of them together.
MAX_ZEROS = 10_000_000
# Each primitive gets vertices of its own, also where many share one buffer.
MAX_VERTICES = 60_000_000
# Nodes that show a mesh again multiply its triangles, which costs a file nothing.
MAX_REPEATED = 5_000_000
# What views and accessors may take beyond twice the bytes that are there: each becomes a copy.
SPARE_BYTES = 2 << 30
COMPRESSED = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
TRIANGLES, STRIP, FAN = 4, 5, 6


def check_gltf(path: Path, file: GltfFile) -> None:
    """Raise FileFormatError if a file would be misread or exhaust memory."""
    tree = file.tree
    try:
        _refuse_compressed(path, tree)
        views = [_view(file, k, view) for k, view in enumerate(tree.get("bufferViews", []))]
        sizes = [
            _accessor(path, k, accessor, tree.get("bufferViews", []), views)
            for k, accessor in enumerate(tree.get("accessors", []))
        ]
        _check_sizes(path, file, sum(views), sum(sizes))
        _nodes(path, tree)
    # Infinity is a number for Python's JSON, and no integer.
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise FileFormatError(path, f"damaged glTF header: {error!r}") from error


def _refuse_compressed(path: Path, tree: dict[str, Any]) -> None:
    used = {*tree.get("extensionsUsed", []), *tree.get("extensionsRequired", [])}
    for name, what in COMPRESSED.items():
        inside = any(
            name in primitive.get("extensions", {})
            for mesh in tree.get("meshes", [])
            for primitive in mesh["primitives"]
        ) or any(name in view.get("extensions", {}) for view in tree.get("bufferViews", []))
        if inside or (name in used and name in tree.get("extensionsRequired", [])):
            raise FileFormatError(
                path,
                f"its meshes are {what}-compressed ({name}), which is not supported; "
                "decompress them first, for example with `gltf-transform copy in.glb out.glb`",
            )


def _view(file: GltfFile, index: int, view: dict[str, Any]) -> int:
    """Return the length of a buffer view; raise if it extends beyond its buffer."""
    offset, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
    if (number := int(view["buffer"])) < 0:
        raise ValueError(f"buffer index {number} is negative")
    held = len(file.buffer(number))
    if offset < 0 or length < 0 or offset + length > held:
        raise ValueError(f"buffer view {index} ends at {offset + length:,} of {held:,} bytes")
    return length


def _accessor(
    path: Path,
    index: int,
    accessor: dict[str, Any],
    views: list[dict[str, Any]],
    lengths: list[int],
) -> int:
    """Return the size of an accessor in bytes; raise if it extends beyond its buffer view."""
    count = int(accessor["count"])
    size = COMPONENT_BYTES[accessor["componentType"]] * COMPONENTS[accessor["type"]]
    if count < 0:
        raise ValueError(f"accessor {index} has a count of {count}; valid: at least 0")
    if "bufferView" not in accessor:
        if count > MAX_ZEROS:
            raise ValueError(f"accessor {index} declares {count:,} elements without data")
        return count * size
    number = int(accessor["bufferView"])
    if not 0 <= number < len(views):
        raise ValueError(f"accessor {index} refers to buffer view {number}; there are {len(views)}")
    stride = int(views[number].get("byteStride", 0)) or size
    offset = int(accessor.get("byteOffset", 0))
    end = offset + (stride * (count - 1) + size if count else 0)
    if offset < 0 or stride < size or end > lengths[number]:
        raise FileFormatError(
            path,
            f"accessor {index} ({count:,} elements) ends at byte {end:,} of a buffer view of "
            f"{lengths[number]:,}",
        )
    return count * size


def _check_sizes(path: Path, file: GltfFile, in_views: int, in_accessors: int) -> None:
    """Limit data that is referred to many times."""
    zeros = sum(int(a["count"]) for a in file.tree.get("accessors", []) if "bufferView" not in a)
    if zeros > MAX_ZEROS:
        raise FileFormatError(path, f"its accessors declare {zeros:,} elements without data")
    held = file.held_bytes()
    for what, total in (("buffer views", in_views), ("accessors", in_accessors)):
        if total > 2 * held + SPARE_BYTES:
            raise FileFormatError(
                path, f"its {what} refer to {total:,} bytes in total; only {held:,} exist"
            )


def _nodes(path: Path, tree: dict[str, Any]) -> None:
    """Check that nodes form a forest and do not instance meshes too often."""
    nodes, meshes = tree.get("nodes", []), tree.get("meshes", [])
    accessors = tree.get("accessors", [])
    primitives = [primitive for mesh in meshes for primitive in mesh["primitives"]]
    places = [primitive["attributes"].get("POSITION") for primitive in primitives]
    vertices = sum(int(accessors[k]["count"]) for k in places if k is not None)
    if vertices > MAX_VERTICES:
        raise FileFormatError(
            path,
            f"its primitives have {vertices:,} vertices in total, counting shared ones each time; "
            f"valid: up to {MAX_VERTICES:,}",
        )
    triangles = [_triangles(mesh, accessors) for mesh in meshes]
    scenes = tree.get("scenes", [])
    roots = [n for scene in scenes for n in scene.get("nodes", [])] or list(range(len(nodes)))
    children = {int(c) for node in nodes for c in node.get("children", [])}
    if not scenes:
        roots = [n for n in roots if n not in children]
    seen: set[int] = set()
    waiting = [(int(n), 0) for n in dict.fromkeys(roots)]
    total = placed = 0
    while waiting:
        number, depth = waiting.pop()
        if not 0 <= number < len(nodes):
            raise ValueError(f"node {number} does not exist; there are {len(nodes)}")
        if number in seen:
            raise FileFormatError(path, f"node {number} has two parents, or is its own ancestor")
        if depth > MAX_DEPTH:
            raise FileFormatError(path, f"its nodes are nested more than {MAX_DEPTH} deep")
        seen.add(number)
        waiting += [(int(c), depth + 1) for c in nodes[number].get("children", [])]
        if (mesh := nodes[number].get("mesh")) is not None:
            if not 0 <= mesh < len(meshes):
                raise ValueError(f"node {number} refers to mesh {mesh}; there are {len(meshes)}")
            placed += len(meshes[mesh]["primitives"])
            total += triangles[mesh]
    if placed > MAX_NODES:
        raise FileFormatError(
            path, f"contains {placed:,} primitives; valid: up to {MAX_NODES:,} (join them first)"
        )
    if total > MAX_TRIANGLES:
        raise FileFormatError(path, f"contains {total:,} triangles; valid: up to {MAX_TRIANGLES:,}")
    if total > max(MAX_REPEATED, 2 * sum(triangles)):
        raise FileFormatError(
            path,
            f"instances {sum(triangles):,} triangles so often that they become {total:,}; valid: "
            f"up to {MAX_REPEATED:,}, or twice as many as it stores",
        )


def _triangles(mesh: dict[str, Any], accessors: list[dict[str, Any]]) -> int:
    count = 0
    for primitive in mesh["primitives"]:
        position = primitive["attributes"].get("POSITION")
        index = primitive.get("indices", position)
        if index is None:
            continue
        for number in (index, position):
            if number is not None and not 0 <= number < len(accessors):
                raise ValueError(
                    f"a primitive refers to accessor {number}; there are {len(accessors)}"
                )
        corners = int(accessors[index]["count"])
        mode = primitive.get("mode", TRIANGLES)
        count += corners // 3 if mode == TRIANGLES else corners if mode in (STRIP, FAN) else 0
        place = accessors[position] if position is not None else {}
        if place.get("normalized"):
            raise ValueError(
                "positions are quantised (KHR_mesh_quantization), which is not supported; "
                "dequantise them first"
            )
    return count
