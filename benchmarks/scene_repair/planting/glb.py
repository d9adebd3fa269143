"""Reading a GLB so that single meshes can be replaced, everything else staying byte for byte.

Readers of whole scenes compress the textures again when they write; a scan with holes cut into it
must differ from the scan by the holes alone.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vlnpe.formats.core.arrays import F32, I64, Array
from vlnpe.formats.core.frames import (
    habitat_to_world_position,
    quat_to_matrix,
    world_to_habitat_position,
    xyzw_to_wxyz,
)
from vlnpe.formats.untrusted.glb import glb_bytes, read_glb

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FLOAT, _UINT = 5126, 5125
_TABLES = (
    "bufferViews", "accessors", "images", "samplers", "textures", "materials", "meshes", "nodes",
)  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One primitive of one node.

    Attributes:
        name: of the node.
        node, mesh, primitive: indices in the file.
        points_m: (V, 3) positions, z up [m].
        faces: (F, 3) int64.
        others: further vertex attributes, (V, n) each.
    """

    name: str
    node: int
    mesh: int
    primitive: int
    points_m: Array
    faces: I64
    others: dict[str, F32]


class Glb:
    """A GLB of triangle meshes, each used by one node, without compression."""

    def __init__(self, path: Path) -> None:
        text, body = read_glb(path)
        self.tree: dict[str, Any] = json.loads(text)
        self.body = bytearray(body)
        self._pose = self._poses()

    def parts(self) -> list[Part]:
        """Return every primitive, with positions turned z up."""
        parts = []
        for k, node in enumerate(self.tree["nodes"]):
            if "mesh" not in node:
                continue
            for p, primitive in enumerate(self.tree["meshes"][node["mesh"]]["primitives"]):
                read = {n: self._read(i) for n, i in primitive["attributes"].items()}
                local = read.pop("POSITION").astype(np.float64)
                pose = self._pose[k]
                points = habitat_to_world_position(local @ pose[:3, :3].T + pose[:3, 3])
                faces = self._read(primitive["indices"]).astype(np.int64).reshape(-1, 3)
                others = {n: a.astype(np.float32) for n, a in read.items()}
                name = node.get("name", f"node_{k}")
                parts.append(Part(name, k, node["mesh"], p, points, faces, others))
        return parts

    def replace(self, part: Part) -> None:
        """Write a changed part back."""
        inverse = np.linalg.inv(self._pose[part.node])
        source = world_to_habitat_position(part.points_m)
        local = source @ inverse[:3, :3].T + inverse[:3, 3]
        primitive = self.tree["meshes"][part.mesh]["primitives"][part.primitive]
        primitive["attributes"] = {
            "POSITION": self._append(local.astype("<f4")),
            **{name: self._append(values.astype("<f4")) for name, values in part.others.items()},
        }
        primitive["indices"] = self._append(part.faces.ravel().astype("<u4"))

    def add(
        self,
        name: str,
        points_m: Array,
        faces: I64,
        color: tuple[float, float, float],
    ) -> None:
        """Append a node in one plain colour, positions z up."""
        materials = self.tree.setdefault("materials", [])
        materials.append(
            {
                "name": name,
                "doubleSided": True,
                "pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0},
            }
        )
        local = world_to_habitat_position(points_m).astype("<f4")
        primitive = {
            "attributes": {"POSITION": self._append(local)},
            "indices": self._append(faces.ravel().astype("<u4")),
            "material": len(materials) - 1,
        }
        self.tree["meshes"].append({"name": name, "primitives": [primitive]})
        self.tree["nodes"].append({"name": name, "mesh": len(self.tree["meshes"]) - 1})
        self.tree["scenes"][self.tree.get("scene", 0)]["nodes"].append(len(self.tree["nodes"]) - 1)
        self._pose.append(np.eye(4))

    def absorb(self, other: "Glb", shift_m: Array) -> None:
        """Append everything of another file, shifted by (3,), z up."""
        self.body += b"\0" * (-len(self.body) % 4)
        start = len(self.body)
        self.body += other.body
        counts = {key: len(self.tree.get(key, [])) for key in _TABLES}

        def moved(key: str, row: dict[str, Any], *fields: tuple[str, str]) -> None:
            row = json.loads(json.dumps(row))
            for field, table in fields:
                if field in row:
                    row[field] += counts[table]
            self.tree.setdefault(key, []).append(row)

        for view in other.tree["bufferViews"]:
            moved("bufferViews", {**view, "byteOffset": view.get("byteOffset", 0) + start})
        for accessor in other.tree["accessors"]:
            moved("accessors", accessor, ("bufferView", "bufferViews"))
        for image in other.tree.get("images", []):
            moved("images", image, ("bufferView", "bufferViews"))
        for sampler in other.tree.get("samplers", []):
            moved("samplers", sampler)
        for texture in other.tree.get("textures", []):
            moved("textures", texture, ("source", "images"), ("sampler", "samplers"))
        for material in other.tree.get("materials", []):
            moved("materials", material)
            entry = self.tree["materials"][-1].get("pbrMetallicRoughness", {})
            if "baseColorTexture" in entry:
                entry["baseColorTexture"]["index"] += counts["textures"]
        for mesh in other.tree["meshes"]:
            moved("meshes", mesh)
            for primitive in self.tree["meshes"][-1]["primitives"]:
                primitive["attributes"] = {
                    name: index + counts["accessors"]
                    for name, index in primitive["attributes"].items()
                }
                primitive["indices"] += counts["accessors"]
                if "material" in primitive:
                    primitive["material"] += counts["materials"]
        for node in other.tree["nodes"]:
            moved("nodes", node, ("mesh", "meshes"))
            new = self.tree["nodes"][-1]
            new["children"] = [child + counts["nodes"] for child in node.get("children", [])]
            if not new["children"]:
                del new["children"]
        roots = [
            k + counts["nodes"] for k in other.tree["scenes"][other.tree.get("scene", 0)]["nodes"]
        ]
        self.tree["nodes"].append(
            {
                "name": f"group_{len(self.tree['nodes'])}",
                "translation": world_to_habitat_position(shift_m).tolist(),
                "children": roots,
            }
        )
        self.tree["scenes"][self.tree.get("scene", 0)]["nodes"].append(len(self.tree["nodes"]) - 1)
        self._pose = self._poses()

    def write(self, path: Path) -> None:
        """Write the file."""
        self.body += b"\0" * (-len(self.body) % 4)
        self.tree["buffers"] = [{"byteLength": len(self.body)}]
        path.write_bytes(glb_bytes(self.tree, self.body))

    def _poses(self) -> list[Array]:
        """Return (4, 4) of every node to the scene."""
        nodes = self.tree["nodes"]
        poses = [_matrix(node) for node in nodes]
        done: list[Array | None] = [None] * len(nodes)
        queue = [(k, np.eye(4)) for k in self.tree["scenes"][self.tree.get("scene", 0)]["nodes"]]
        while queue:
            k, parent = queue.pop()
            done[k] = parent @ poses[k]
            queue += [(child, done[k]) for child in nodes[k].get("children", [])]
        return [np.eye(4) if pose is None else pose for pose in done]

    def _read(self, index: int) -> NDArray[Any]:
        accessor = self.tree["accessors"][index]
        view = self.tree["bufferViews"][accessor["bufferView"]]
        kind, width = _TYPES[accessor["componentType"]], _WIDTHS[accessor["type"]]
        item = np.dtype(kind).itemsize * width
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", item)
        count = accessor["count"]
        raw = np.frombuffer(self.body, np.uint8, stride * (count - 1) + item, start)
        rows = np.lib.stride_tricks.as_strided(raw, (count, item), (stride, 1))
        values = np.ascontiguousarray(rows).view(kind)
        return values if width > 1 else values[:, 0]

    def _append(self, array: NDArray[Any]) -> int:
        self.body += b"\0" * (-len(self.body) % 4)
        raw = np.ascontiguousarray(array).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.body), "byteLength": len(raw)}
        self.body += raw
        self.tree["bufferViews"].append(view)
        entry: dict[str, Any] = {
            "bufferView": len(self.tree["bufferViews"]) - 1,
            "componentType": _FLOAT if array.dtype.kind == "f" else _UINT,
            "count": len(array),
            "type": "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}",
        }
        if entry["type"] == "VEC3":
            entry["min"], entry["max"] = array.min(0).tolist(), array.max(0).tolist()
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1


def _matrix(node: dict[str, Any]) -> Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    pose = np.eye(4)
    rotation = quat_to_matrix(xyzw_to_wxyz(node.get("rotation", (0.0, 0.0, 0.0, 1.0))))
    pose[:3, :3] = rotation * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    pose[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return pose
