"""A scan as read: one triangle soup with a material and an object per face.

Colours are sRGB; the transfer function is below.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from ...formats.core.arrays import F32, I32, I64, Array, Mask
from ...formats.core.errors import without_addresses

# Surfaces that say nothing of their colour: plaster.
DEFAULT_COLOR = (0.75, 0.74, 0.72)


@dataclass(frozen=True)
class ScanMaterial:
    """Material of source faces: base colour (sRGB, 0–1) times an optional RGB image."""

    name: str
    base_color: tuple[float, float, float]
    image: Image.Image | None = None


@dataclass(frozen=True)
class ScanObject:
    """A named part of the source; its faces point to it by index."""

    name: str
    category: str


class Companion(Protocol):
    """What a scan holds beside its surface, and the bundle keeps: Gaussian splats."""

    def save(self, folder: Path, source_to_world: Array) -> dict[str, Any]:
        """Write it into a bundle's folder, in world coordinates; return facts of the source."""
        ...


@dataclass(frozen=True)
class Scan:
    """Triangles in source coordinates, near the origin.

    Attributes:
        vertices: (V, 3) float64, source units, less `offset`.
        faces: (F, 3) int64.
        corner_uv: (F, 3, 2) float32; v up.
        face_material: (F,) int32 index into `materials`.
        face_object: (F,) int32 index into `objects`, −1 = none.
        parts: names of the file's pieces, one a node or prim; those with a known category are also
            objects.
        face_part: (F,) int32 index into `parts`.
        offset: (3,) to add to positions for the file's coordinates.
        up: axis that the file promises to be up, with the reason, or None.
        unit: unit that the file promises, with the reason, or None.
        converted: a converter wrote the file that keeps the axes of what it converts.
        licence: what the file says, empty if nothing.
        generator: facts of a generated scene, empty for a real scan.
        warnings: what had to be dropped or replaced while reading.
        companion: what the bundle keeps beside the surface; None for meshes and point clouds.
    """

    vertices: Array
    faces: I64
    corner_uv: F32
    face_material: I32
    face_object: I32
    materials: tuple[ScanMaterial, ...]
    objects: tuple[ScanObject, ...] = ()
    parts: tuple[str, ...] = ("",)
    face_part: I32 = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    up: tuple[str, str] | None = None
    unit: tuple[str, str] | None = None
    converted: bool = False
    licence: str = ""
    generator: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    companion: Companion | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "warnings", tuple(map(without_addresses, self.warnings)))
        if not len(self.face_part):
            object.__setattr__(self, "face_part", np.zeros(len(self.faces), dtype=np.int32))

    def take_faces(self, selected: Mask) -> "Scan":
        """Return the scan with the faces (F,) that are selected."""
        arrays = ("faces", "corner_uv", "face_material", "face_object", "face_part")
        changes: dict[str, Any] = {name: getattr(self, name)[selected] for name in arrays}
        return replace(self, **changes)

    def object_faces(self) -> list[I64]:
        """Return the face indices of each object."""
        order = np.argsort(self.face_object, kind="stable")
        ends = np.searchsorted(self.face_object[order], np.arange(len(self.objects) + 1))
        return [order[a:b] for a, b in pairwise(ends)]


def srgb_to_linear(srgb: Array) -> Array:
    """Apply the sRGB transfer function (IEC 61966-2-1); values in 0–1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(linear: Array) -> Array:
    """Apply the sRGB transfer function (IEC 61966-2-1); values in 0–1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
