"""Assign images to the materials of a glTF file."""

from dataclasses import replace

import numpy as np
from PIL import Image

from ...formats.core.errors import FileFormatError
from ..scan.images import PixelBudget, decode_all, open_image
from ..scan.soup import ScanPart
from .file import ColorImage, GltfFile


def with_images(parts: list[ScanPart], file: GltfFile, warnings: list[str]) -> list[ScanPart]:
    """Restore names and images of materials that are named by their number."""
    materials = file.tree.get("materials", [])
    opened: dict[str, Image.Image] = {}
    budget = PixelBudget()
    tried: set[str] = set()
    by_material: dict[int, ColorImage] = {}
    for number in sorted({int(p.material.name) for p in parts if _numbered(p, materials)}):
        try:
            picture = file.color_image_of(number)
            if picture is None:
                continue
            if picture.coordinates:
                warnings.append(
                    f"picture {picture.name} takes texture coordinates {picture.coordinates}; "
                    "only the first set is read"
                )
            by_material[number] = picture
            place = file.image_location(picture.image)
            if place not in tried:
                tried.add(place)
                data = file.image_bytes(picture.image)
                image = open_image(data, picture.name, warnings, budget)
                if image is not None:
                    opened[place] = image
        except (
            OSError,
            ValueError,
            KeyError,
            IndexError,
            TypeError,
            AttributeError,
            OverflowError,
            FileFormatError,
        ) as error:
            warnings.append(f"material {number}: its picture cannot be read ({error})")
    pictures = decode_all(opened, warnings)
    result = []
    for part in parts:
        if not _numbered(part, materials):
            result.append(part)
            continue
        number = int(part.material.name)
        name = str(materials[number].get("name") or f"material_{number}")
        picture = by_material.get(number)
        image = pictures.get(file.image_location(picture.image)) if picture else None
        uv = part.uv
        if picture is not None and image is not None and np.any(picture.to_uv != np.eye(2, 3)):
            # The map is meant for v down.
            down = uv * (1, -1) + (0, 1)
            down = down @ picture.to_uv[:, :2].T + picture.to_uv[:, 2]
            uv = (down * (1, -1) + (0, 1)).astype(np.float32)
        result.append(replace(part, uv=uv, material=replace(part.material, name=name, image=image)))
    return result


def _numbered(part: ScanPart, materials: list[object]) -> bool:
    name = part.material.name
    return name.isdecimal() and int(name) < len(materials)
