"""GLB files with one triangle, written by hand."""

import json
import struct
from typing import Any

import numpy as np

from vlnpe.scene_repair.scan.record import Scan


def check_sound(scan: Scan) -> None:
    assert np.isfinite(scan.vertices).all()
    assert np.isfinite(scan.corner_uv).all()
    assert scan.faces.min() >= 0
    assert scan.faces.max() < len(scan.vertices)
    assert len(scan.faces) == len(scan.corner_uv) == len(scan.face_material)
    assert scan.face_material.min() >= 0
    assert scan.face_material.max() < len(scan.materials)
    assert scan.face_object.max() < max(len(scan.objects), 1)


def glb(tree: dict[str, Any], data: bytes = b"") -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if data:
        data += b"\0" * (-len(data) % 4)
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle_tree(**more: Any) -> tuple[dict[str, Any], bytes]:
    """A GLB with one triangle, by hand."""
    data = np.array([0, 0, 0, 2, 0, 0, 2, 0, 2], "<f4").tobytes() + bytes([0, 0, 1, 0, 2, 0])
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return {**tree, **more}, data


def picture_tree(uri: str) -> tuple[dict[str, Any], bytes]:
    tree, data = triangle_tree(
        images=[{"uri": uri}],
        textures=[{"source": 0}],
        materials=[{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    primitive["attributes"]["TEXCOORD_0"] = 2
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": 24})
    tree["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2"})
    data += bytes(2) + np.array([0, 0, 1, 0, 1, 1], "<f4").tobytes()
    tree["bufferViews"][2]["byteOffset"] = 44
    tree["buffers"][0]["byteLength"] = len(data)
    return tree, data
