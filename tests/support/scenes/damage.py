"""Small valid scans of every format, and ways to damage them that look like the format."""

import io
import json
import re
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from hypothesis import strategies as st
from PIL import Image
from trimesh.visual.color import ColorVisuals
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from tests.support.scenes import scans

USDA = b"""#usda 1.0
(
    defaultPrim = "R"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "R"
{
    double3 xformOp:translate = (0, 0, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "floor" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 2]
        rel material:binding = </R/Looks/A>
        point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)]
    }
    def PointInstancer "many"
    {
        rel prototypes = [</R/floor>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (4, 0, 0)]
    }
    def Material "Looks"
    {
        def Material "A"
        {
            token outputs:surface.connect = </R/Looks/A/S.outputs:surface>
            def Shader "S"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.2, 0.4, 0.6)
                token outputs:surface
            }
        }
    }
}
"""
PCD = (
    b"VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 4\nHEIGHT 1\n"
    b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA binary\n"
)
# Numbers that readers trip over.
NUMBERS = [-1, 0, 1, 2, 3, 7, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63, -(2**31), 1e30]
WORDS = [
    "nan",
    "inf",
    "-1",
    "0",
    "4294967295",
    "99999999999",
    "1e400",
    "",
    "x",
    "../a",
    "/etc/passwd",
]


def exported(shape: Any, kind: str, **options: Any) -> bytes:
    """Return a mesh or scene of trimesh as a file of a kind."""
    data = shape.export(file_type=kind, **options)
    return data.encode() if isinstance(data, str) else data


def sound_files() -> dict[str, bytes]:
    """One small file of each format."""
    mesh = scans.sheet((0, 0), (2, 2), step=1.0)
    picture = Image.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3))
    textured = mesh.copy()
    textured.visual = TextureVisuals(
        uv=mesh.vertices[:, :2] / 2, material=PBRMaterial(baseColorTexture=picture)
    )
    scene = trimesh.Scene()
    scene.add_geometry(textured, node_name="Floor_1")
    scene.add_geometry(scans.box((0, 0, 0), (1, 1, 1)), node_name="Box_1")
    colored = mesh.copy()
    rgba = np.arange(4 * len(mesh.vertices)).reshape(-1, 4) % 255
    colored.visual = ColorVisuals(colored, vertex_colors=rgba)
    points = np.arange(16, dtype="<f4").tobytes()
    return {
        "glb": exported(scene, "glb"),
        "obj": b"mtllib a.mtl\no Floor_1\nusemtl a\n" + exported(mesh, "obj"),
        "ply": exported(colored, "ply"),
        "ascii.ply": exported(colored, "ply", encoding="ascii"),
        "stl": exported(mesh, "stl"),
        "off": exported(mesh, "off"),
        "usda": USDA,
        "pcd": PCD + points,
    }


@st.composite
def flipped(draw: st.DrawFn, raw: bytes) -> bytes:
    """Some bytes changed, then perhaps cut off."""
    data = bytearray(raw)
    for _ in range(draw(st.integers(0, 6))):
        data[draw(st.integers(0, len(data) - 1))] = draw(st.integers(0, 255))
    cut = draw(st.integers(0, len(data)) | st.just(len(data)))
    return bytes(data[:cut])


@st.composite
def rewritten(draw: st.DrawFn, raw: bytes) -> bytes:
    """Words and numbers of a text (or of a text header) replaced."""
    text = raw
    for _ in range(draw(st.integers(1, 3))):
        found = list(re.finditer(rb"-?\d[\d.e+-]*|[A-Za-z_:]+", text[:4000]))
        if not found:
            break
        hit = found[draw(st.integers(0, len(found) - 1))]
        word = draw(st.sampled_from(WORDS) | st.sampled_from([str(n) for n in NUMBERS]))
        text = text[: hit.start()] + word.encode() + text[hit.end() :]
    return text


@st.composite
def retold(draw: st.DrawFn, raw: bytes) -> bytes:
    """Return a GLB with a changed JSON tree."""
    length = struct.unpack_from("<I", raw, 12)[0]
    tree, rest = json.loads(raw[20 : 20 + length]), raw[20 + length :]
    places: list[tuple[object, object]] = []

    def collect(at: object) -> None:
        pairs = (
            at.items() if isinstance(at, dict) else enumerate(at) if isinstance(at, list) else ()
        )
        for key, value in pairs:
            places.append((at, key))
            collect(value)

    for _ in range(draw(st.integers(1, 3))):
        places.clear()
        collect(tree)
        home, key = places[draw(st.integers(0, len(places) - 1))]
        values = st.sampled_from([*NUMBERS, None, True, [], {}, "x", "../a", [0], {"index": 0}])
        if isinstance(home, dict) and draw(st.booleans()):
            del home[key]
        else:
            home[key] = draw(values)  # type: ignore[index]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def damage(suffix: str, raw: bytes) -> st.SearchStrategy[bytes]:
    """Damaged versions of a file."""
    ways: list[Callable[[bytes], st.SearchStrategy[bytes]]] = [flipped, rewritten]
    if suffix == "glb":
        ways.append(retold)
    return st.one_of(*(way(raw) for way in ways))


def picture_bytes(width: int, height: int, kind: str = "PNG", **options: object) -> bytes:
    """A picture of one colour."""
    stream = io.BytesIO()
    Image.new("RGB", (width, height), (10, 200, 30)).save(stream, kind, **options)
    return stream.getvalue()
