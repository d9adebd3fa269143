"""A parsed glTF file: its JSON tree, its buffers and the images of its materials."""

import base64
import binascii
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.errors import FileFormatError
from ...formats.untrusted.documents import parse_json
from ...formats.untrusted.files import check_input, read_input
from ...formats.untrusted.glb import glb_bytes, read_glb
from ...formats.untrusted.limits import limits
from ..scan.resolver import ConfinedResolver

# Parts of the tree that are lists of objects.
TABLES = (
    "accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "samplers",
    "scenes", "textures",
)  # fmt: skip
# Where a material may name the picture of its colour: (extension, key).
COLOR_PICTURES = (
    ("", "baseColorTexture"),
    ("KHR_materials_pbrSpecularGlossiness", "diffuseTexture"),
)
PICTURE_SOURCES = ("EXT_texture_webp",)
# What is read of vertices; the library would copy all others, too, for each piece.
ATTRIBUTES = ("POSITION", "TEXCOORD_0", "COLOR_0")
OWN_GENERATOR = "vlnpe"


@dataclass(frozen=True)
class ColorImage:
    """The base colour image of a material, and its name in messages.

    Its set of `coordinates`, v down, goes through the affine map `to_uv` (2, 3).
    """

    image: int
    name: str
    to_uv: Array
    coordinates: int


class GltfFile:
    """A GLB or glTF file with a parsed header; images are read separately.

    Raises:
        FileFormatError: the header is damaged, or a buffer is missing or outside the folder.
    """

    def __init__(self, path: Path, resolver: ConfinedResolver):
        self.path, self.resolver = path, resolver
        try:
            text, self._bin = _contents(path)
        except ValueError as error:
            raise FileFormatError(path, f"damaged glTF header: {error}") from error
        try:
            self.tree: dict[str, Any] = parse_json(path, text)
        except FileFormatError as error:
            raise FileFormatError(path, f"damaged glTF header: {error.reason}") from error
        if not isinstance(self.tree, dict) or not isinstance(self.tree.get("asset"), dict):
            raise FileFormatError(path, "damaged glTF header: no asset")
        version = str(self.tree["asset"].get("version", "2"))
        if version.split(".")[0] != "2":
            raise FileFormatError(path, f"is glTF {version}; valid: 2.x")
        for kind in TABLES:
            table = self.tree.get(kind, [])
            if not isinstance(table, list) or not all(isinstance(e, dict) for e in table):
                raise FileFormatError(path, f"damaged glTF header: {kind} is not a list of objects")
        self._buffers: dict[int, bytes | memoryview] = {}

    def buffer(self, index: int) -> bytes | memoryview:
        """Return the bytes of a buffer; raise FileFormatError if it cannot be read."""
        if index not in self._buffers:
            entry = self.tree["buffers"][index]
            self._buffers[index] = self._bytes_of(entry["uri"]) if "uri" in entry else self._bin
        return self._buffers[index]

    def held_bytes(self) -> int:
        """Return the size in bytes of all buffers read so far; each file counts once."""
        return sum({id(data): len(data) for data in self._buffers.values()}.values())

    def _bytes_of(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except (binascii.Error, ValueError) as error:
                raise FileFormatError(
                    self.path, f"embedded data is not valid base64: {error}"
                ) from error
        try:
            return self.resolver.get(unquote(uri))
        except OSError as error:
            raise FileFormatError(self.path, str(error)) from error

    def color_image_of(self, material: int) -> ColorImage | None:
        """Return the base colour image of a material; None if it has none."""
        entry = self.tree.get("materials", [])[material]
        for extension, key in COLOR_PICTURES:
            home = (
                entry.get("extensions", {}).get(extension, {})
                if extension
                else (entry.get("pbrMetallicRoughness", {}))
            )
            if (info := home.get(key)) is None:
                continue
            texture = self.tree["textures"][info["index"]]
            image = texture.get("source")
            for source in PICTURE_SOURCES:
                image = texture.get("extensions", {}).get(source, {}).get("source", image)
            if image is None or not 0 <= image < len(self.tree.get("images", [])):
                return None
            name = self.tree["images"][image].get("name") or f"image {image}"
            transform = info.get("extensions", {}).get("KHR_texture_transform", {})
            coordinates = transform.get("texCoord", info.get("texCoord", 0))
            return ColorImage(int(image), str(name), _affine(transform), int(coordinates))
        return None

    def image_location(self, image: int) -> str:
        """Return where an image's data lies (images may share it); raise ValueError if nowhere."""
        entry = self.tree["images"][image]
        if "bufferView" in entry:
            return f"view {entry['bufferView']}"
        if not isinstance(entry.get("uri"), str):
            raise ValueError("it has neither a buffer view nor a URI")
        return entry["uri"]

    def image_bytes(self, image: int) -> bytes:
        """Return the encoded bytes of an image; raise OSError or ValueError if there are none."""
        entry = self.tree["images"][image]
        if "bufferView" in entry:
            view = self.tree["bufferViews"][entry["bufferView"]]
            start = int(view.get("byteOffset", 0))
            return bytes(self.buffer(int(view["buffer"]))[start : start + int(view["byteLength"])])
        uri = self.image_location(image)
        return self._bytes_of(uri) if uri.startswith("data:") else self.resolver.get(unquote(uri))

    def without_images(self) -> io.BytesIO:
        """Return the file's bytes without images and unused vertex attributes.

        Images are opened separately, in bounded memory; materials are named by their number.
        """
        tree = {k: v for k, v in self.tree.items() if k not in ("images", "textures")}
        materials = [
            {**entry, "name": str(k)} for k, entry in enumerate(self.tree.get("materials", []))
        ]
        if materials:
            tree["materials"] = materials
        if "meshes" in tree:
            tree["meshes"] = [
                {**mesh, "primitives": [_plain(p) for p in mesh["primitives"]]}
                for mesh in tree["meshes"]
            ]
        if self.path.suffix.lower() == ".gltf":
            return io.BytesIO(json.dumps(tree).encode())
        return io.BytesIO(glb_bytes(tree, self._bin))


def _plain(primitive: dict[str, Any]) -> dict[str, Any]:
    attributes = {k: v for k, v in primitive["attributes"].items() if k in ATTRIBUTES}
    return {**primitive, "attributes": attributes}


def _affine(transform: dict[str, Any]) -> Array:
    """Return the affine map of KHR_texture_transform: scale, then rotate, then translate."""
    angle = float(transform.get("rotation", 0.0))
    if not np.isfinite(angle):
        raise ValueError("its texture transform is not finite")
    scale = np.array(transform.get("scale", (1.0, 1.0)), dtype=np.float64)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    result = np.zeros((2, 3))
    result[:, :2] = turn * scale[None, :]
    result[:, 2] = transform.get("offset", (0.0, 0.0))
    if not np.isfinite(result).all():
        raise ValueError("its texture transform is not finite")
    return result


def _contents(path: Path) -> tuple[bytes, memoryview]:
    """Return JSON text and binary chunk of a file; the chunk of a .gltf file is empty."""
    if path.suffix.lower() != ".gltf":
        return read_glb(path)
    size, cap = check_input(path), limits().json_bytes
    if size > cap:
        raise FileFormatError(
            path,
            f"has {size:,} bytes of JSON; valid: up to {cap:,} (store large buffers and pictures "
            "beside it, or in a .glb, instead of in data: URIs)",
        )
    return read_input(path, max_bytes=cap), memoryview(b"")


def gltf_facts(tree: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return licence (empty if not stated) and generator facts from a glTF file's JSON tree."""
    asset = tree.get("asset", {})
    extras = asset.get("extras", {})
    extras = extras if isinstance(extras, dict) else {}
    licence = str(extras.get("licence") or extras.get("license") or asset.get("copyright") or "")
    if asset.get("generator") != OWN_GENERATOR:
        return licence, {}
    return licence, {k: v for k, v in extras.items() if k not in ("licence", "license")}
