"""Write a binary glTF of textured, named nodes.

trimesh's exporter compresses embedded JPEG images again at its default quality; here the pages go
into the file as they were encoded.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..formats.core.arrays import F32, U8
from ..formats.untrusted.glb import glb_bytes

_FLOAT, _UINT = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963
_REPEAT, _CLAMP = 10497, 33071


@dataclass(frozen=True)
class GlbNode:
    """Triangles with one texture; consecutive ones of one name become one node of the file.

    Attributes:
        vertices: (V, 3) float32 [m], y up.
        uv: (V, 2) float32, v down from the image's top as glTF has it.
        faces: (F, 3) uint32.
        page: index of its image.
    """

    name: str
    vertices: F32
    uv: F32
    faces: NDArray[np.uint32]
    page: int


class _Buffer:
    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict] = []
        self.accessors: list[dict] = []

    def view(self, raw: bytes, target: int | None = None) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        entry = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw)}
        if target is not None:
            entry["target"] = target
        self.data += raw
        self.views.append(entry)
        return len(self.views) - 1

    def accessor(self, array: NDArray, kind: str, component: int, target: int) -> int:
        entry = {
            "bufferView": self.view(np.ascontiguousarray(array).tobytes(), target),
            "componentType": component,
            "count": int(array.size if kind == "SCALAR" else len(array)),
            "type": kind,
        }
        if kind == "VEC3":
            entry["min"], entry["max"] = array.min(0).tolist(), array.max(0).tolist()
        self.accessors.append(entry)
        return len(self.accessors) - 1


def encode_page(image: U8, quality: int) -> bytes:
    """Return an RGB image (rows, columns, 3) as JPEG of the given quality (0–100)."""
    done, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"cannot encode a texture page of shape {image.shape} as JPEG")
    return data.tobytes()


def write_glb(
    path: Path, nodes: list[GlbNode], pages: list[bytes], extras: dict, *, tiled: bool = False
) -> None:
    """Write `nodes` with JPEG `pages`, and `extras` in the asset's header, to `path`.

    `tiled` images repeat beyond their borders; others are clamped.
    """
    wrap = _REPEAT if tiled else _CLAMP
    buffer = _Buffer()
    meshes: list[dict] = []
    for node in nodes:
        position = buffer.accessor(node.vertices.astype("<f4"), "VEC3", _FLOAT, _ARRAY)
        uv = buffer.accessor(node.uv.astype("<f4"), "VEC2", _FLOAT, _ARRAY)
        index = buffer.accessor(node.faces.astype("<u4").ravel(), "SCALAR", _UINT, _ELEMENTS)
        attributes = {"POSITION": position, "TEXCOORD_0": uv}
        primitive = {"attributes": attributes, "indices": index, "material": node.page}
        if meshes and meshes[-1]["name"] == node.name:
            meshes[-1]["primitives"].append(primitive)
        else:
            meshes.append({"name": node.name, "primitives": [primitive]})
    images = [{"bufferView": buffer.view(page), "mimeType": "image/jpeg"} for page in pages]
    matte = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    colors = [{"baseColorTexture": {"index": k}, **matte} for k in range(len(pages))]
    materials = [
        {"name": f"page_{k}", "doubleSided": True, "pbrMetallicRoughness": color}
        for k, color in enumerate(colors)
    ]
    tree = {
        "asset": {"version": "2.0", "generator": "vlnpe", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(meshes)))}],
        "nodes": [{"name": mesh["name"], "mesh": k} for k, mesh in enumerate(meshes)],
        "meshes": meshes,
        "materials": materials,
        "textures": [{"source": k, "sampler": 0} for k in range(len(pages))],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": wrap, "wrapT": wrap}],
        "images": images,
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data) + (-len(buffer.data) % 4)}],
    }
    path.write_bytes(glb_bytes(tree, buffer.data))
