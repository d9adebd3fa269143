"""Read the materials of a USD stage: colour and image of what is bound to a prim."""

import posixpath
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdShade

from ...formats.core.arrays import Array
from ...formats.core.errors import FileFormatError
from ...formats.untrusted.files import read_input
from ..scan.readings import LookRef
from ..scan.record import DEFAULT_COLOR, linear_to_srgb

CONTEXTS = ("", "mdl")
# Inputs that carry the colour of a surface, in the order in which they are asked.
COLOR_INPUTS = ("diffuseColor", "diffuse_color_constant", "base_color", "baseColor", "diffuse_tint")
TEXTURE_INPUT = re.compile(r"(diffuse|albedo|base_?color|color_tex|basecolor)", re.IGNORECASE)
# A texture in the text of an .mdl file: `BaseColor_Tex = texture_2d("./Textures/x.png", …)`.
MDL_TEXTURE = re.compile(r"(\w+)\s*[=:]\s*texture_2d\(\s*\"([^\"]+)\"")
MAX_MDL_BYTES = 1 << 20
TIME = Usd.TimeCode.EarliestTime()


@dataclass(frozen=True)
class Look:
    """A material; the primvar of its coordinates, empty = the first, and their (2, 3) map."""

    ref: LookRef
    primvar: str
    to_uv: Array


PLAIN = Look(LookRef("plain", DEFAULT_COLOR), "", np.eye(2, 3))


class StageMaterials:
    """Materials of a stage, each resolved once; pictures outside of `folder` are not used."""

    def __init__(self, folder: Path, warnings: list[str]):
        self.folder, self.warnings = folder, warnings
        self._known: dict[str, Look] = {}

    def of(self, material: UsdShade.Material | None) -> Look:
        """Return the look of the bound material; plain grey if none is bound."""
        if not material:
            return PLAIN
        path = str(material.GetPath())
        if path not in self._known:
            self._known[path] = self._find(material)
        return self._known[path]

    def _find(self, material: UsdShade.Material) -> Look:
        shader = next(
            (s for s in (material.ComputeSurfaceSource(c)[0] for c in CONTEXTS) if s), None
        )
        name = material.GetPrim().GetName()
        if shader is None:
            return Look(LookRef(name, PLAIN.ref.base_color), "", np.eye(2, 3))
        color, texture, source = self._color(shader)
        file = ""
        tint = np.ones(3) if texture is not None else np.array(PLAIN.ref.base_color)
        if color is not None:
            tint = linear_to_srgb(np.clip(color, 0.0, 1.0))
        member = ""
        if texture is not None:
            file, member = self._picture(*texture)
        if texture is not None and not file and color is None:
            tint = np.array(PLAIN.ref.base_color)
        primvar, to_uv = ("", np.eye(2, 3)) if source is None else _coordinates(source)
        r, g, b = (float(v) for v in tint)
        return Look(LookRef(name, (r, g, b), file, member), primvar, to_uv)

    def _color(
        self, shader: UsdShade.Shader
    ) -> tuple[Array | None, tuple[str, Sdf.Layer] | None, UsdShade.Shader | None]:
        """Return linear colour or scale, picture (name, layer that names it), texture shader."""
        for name in COLOR_INPUTS:
            port = shader.GetInput(name)
            if not port:
                continue
            for attribute in UsdShade.Utils.GetValueProducingAttributes(port):
                producer = UsdShade.Shader(attribute.GetPrim())
                if producer and attribute.GetName().startswith("outputs:"):
                    asset = _asset(producer.GetInput("file"))
                    if asset is not None:
                        scale = producer.GetInput("scale")
                        value = scale.Get(TIME) if scale else None
                        tint = None if value is None else np.array(value, dtype=float)[:3]
                        return tint, asset, producer
                    continue
                value = attribute.Get(TIME)
                if value is not None and len(np.shape(value)) == 1 and np.shape(value)[0] >= 3:
                    result = np.array(value, dtype=float)[:3]
                    return result, self._any_texture(shader), None
        return None, self._any_texture(shader), None

    def _any_texture(self, shader: UsdShade.Shader) -> tuple[str, Sdf.Layer] | None:
        """Return a picture in an input of another shading language, or in its source file."""
        for port in shader.GetInputs():
            if TEXTURE_INPUT.search(port.GetBaseName()):
                asset = _asset(port)
                if asset is not None:
                    return asset
        attribute = shader.GetPrim().GetAttribute("info:mdl:sourceAsset")
        asset = _asset_of(attribute) if attribute else None
        if asset is None:
            return None
        path, member = self._picture(*asset)
        if not path or member:
            return None
        try:
            text = read_input(Path(path), max_bytes=MAX_MDL_BYTES).decode(errors="replace")
        except FileFormatError:
            return None
        for name, picture in MDL_TEXTURE.findall(text):
            if TEXTURE_INPUT.search(name):
                beside = posixpath.join(posixpath.dirname(asset[0]), picture)
                return beside, asset[1]
        return None

    def _picture(self, name: str, layer: Sdf.Layer) -> tuple[str, str]:
        """Return a picture's path (and its package member); empty, with a warning, if unusable."""
        inside = re.fullmatch(r"(.*\.usdz)\[(.*)\]", layer.identifier)
        if inside:
            plain = posixpath.normpath(posixpath.join(posixpath.dirname(inside[2]), name))
            return inside[1], plain
        if layer.realPath.lower().endswith(".usdz"):
            return layer.realPath, posixpath.normpath(name)
        target = (Path(layer.realPath).parent / name).resolve()
        if "://" in name or not target.is_relative_to(self.folder):
            return self._refuse(f"reference {name!r} leads out of the scan's folder; ignored")
        if not target.is_file():
            return self._refuse(f"referenced file {name!r} is missing")
        return str(target), ""

    def _refuse(self, message: str) -> tuple[str, str]:
        if message not in self.warnings:
            self.warnings.append(message)
        return "", ""


def _asset(port: UsdShade.Input | None) -> tuple[str, Sdf.Layer] | None:
    if not port:
        return None
    for attribute in UsdShade.Utils.GetValueProducingAttributes(port):
        result = _asset_of(attribute)
        if result is not None:
            return result
    return None


def _asset_of(attribute: Usd.Attribute) -> tuple[str, Sdf.Layer] | None:
    value: Any = attribute.Get(TIME)
    if not isinstance(value, Sdf.AssetPath) or not value.path:
        return None
    specs = attribute.GetPropertyStack(TIME)
    named = [s for s in specs if s.HasDefaultValue() or s.HasInfo("timeSamples")]
    return (str(value.path), named[0].layer) if named else None


def _coordinates(texture: UsdShade.Shader) -> tuple[str, Array]:
    """Return the primvar that a texture reads and the affine map (2, 3) of its `st` input."""
    to_uv = np.eye(3)
    port = texture.GetInput("st")
    for _ in range(8):
        if not port:
            break
        source = next((a for a in UsdShade.Utils.GetValueProducingAttributes(port)), None)
        shader = UsdShade.Shader(source.GetPrim()) if source else None
        if not shader:
            break
        if shader.GetIdAttr().Get() == "UsdTransform2d":
            to_uv = to_uv @ _transform(shader)
            port = shader.GetInput("in")
            continue
        variable = shader.GetInput("varname")
        attributes = UsdShade.Utils.GetValueProducingAttributes(variable) if variable else []
        value = attributes[0].Get(TIME) if attributes else None
        return str(value or ""), to_uv[:2]
    return "", to_uv[:2]


def _transform(shader: UsdShade.Shader) -> Array:
    """Return (3, 3) of a UsdTransform2d: scale, then rotation, then translation."""

    def get(name: str, default: Any) -> Any:
        port = shader.GetInput(name)
        value = port.Get(TIME) if port else None
        return default if value is None else value

    angle = np.deg2rad(float(get("rotation", 0.0)))
    scale, shift = (
        np.array(get("scale", (1, 1)), float),
        np.array(get("translation", (0, 0)), float),
    )
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    result = np.eye(3)
    result[:2, :2] = turn * scale[None, :]
    result[:2, 2] = shift
    return result
