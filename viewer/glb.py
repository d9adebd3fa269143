"""A scene's triangles as unlit glTF: nothing is left to the browser but to look up textures."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.core.arrays import F32, I64, U8, Floats
from ..formats.untrusted.glb import glb_bytes

_FLOAT, _UINT, _BYTE = 5126, 5125, 5121
_UNLIT = "KHR_materials_unlit"


@dataclass(frozen=True)
class Patch:
    """Triangles of one material.

    Attributes:
        vertices: (V, 3) float32 [m].
        uv: (V, 2) float32, v down from the image's top, as glTF has it.
        rgb: (V, 3) uint8, linear; multiplies the texture.
        faces: (F, 3) uint32.
        image: JPEG, or None.
    """

    vertices: F32
    uv: F32
    rgb: U8
    faces: NDArray[np.uint32]
    image: bytes | None


def unlit_glb(patches: list[Patch], gain: float, opacity: float = 1.0) -> bytes:
    """Return a GLB whose only node has the patches in z-up coordinates, as viser shows them.

    Args:
        gain: multiplies all colours.
        opacity: 0–1.
    """
    data, views, accessors = bytearray(), [], []

    def view(raw: bytes) -> int:
        data.extend(b"\0" * (-len(data) % 4))
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(raw)})
        data.extend(raw)
        return len(views) - 1

    def accessor(array: NDArray[Any], kind: str, component: int, **more: Any) -> int:
        entry = {"bufferView": view(array.tobytes()), "componentType": component, "type": kind}
        count = array.size if kind == "SCALAR" else len(array)
        accessors.append({**entry, "count": count, **more})
        return len(accessors) - 1

    images: dict[bytes, int] = {}
    primitives = []
    for patch in patches:
        bounds = {k: getattr(patch.vertices, k)(0).tolist() for k in ("min", "max")}
        opaque = np.column_stack([patch.rgb, np.full(len(patch.rgb), 255, np.uint8)])
        attributes = {
            "POSITION": accessor(patch.vertices.astype("<f4"), "VEC3", _FLOAT, **bounds),
            "COLOR_0": accessor(opaque, "VEC4", _BYTE, normalized=True),
        }
        if patch.image is None:
            material = 0
        else:
            attributes["TEXCOORD_0"] = accessor(patch.uv.astype("<f4"), "VEC2", _FLOAT)
            material = 1 + images.setdefault(patch.image, len(images))
        indices = accessor(patch.faces.astype("<u4").ravel(), "SCALAR", _UINT)
        primitives.append({"attributes": attributes, "indices": indices, "material": material})
    pages = [{"bufferView": view(image), "mimeType": "image/jpeg"} for image in images]
    bright = {"baseColorFactor": [gain, gain, gain, opacity]}
    blending = {} if opacity == 1.0 else {"alphaMode": "BLEND"}
    colors = [bright, *({"baseColorTexture": {"index": k}, **bright} for k in range(len(pages)))]
    tree = {
        "asset": {"version": "2.0", "generator": "vlnpe"},
        "extensionsUsed": [_UNLIT],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": [
            {
                "doubleSided": True,
                "pbrMetallicRoughness": c,
                "extensions": {_UNLIT: {}},
                **blending,
            }
            for c in colors
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data) + (-len(data) % 4)}],
    }
    if pages:
        tree["images"] = pages
        tree["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]
        tree["textures"] = [{"source": k, "sampler": 0} for k in range(len(pages))]
    return glb_bytes(tree, data)


def unique_rows(rows: Floats) -> tuple[I64, I64]:
    """Return the index of each distinct row, and for each row which of them it is."""
    rows = np.ascontiguousarray(rows)
    flat = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = np.unique(flat, return_index=True, return_inverse=True)
    return first, inverse
