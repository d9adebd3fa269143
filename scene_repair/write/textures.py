"""Copy the scan's images into the bundle."""

from pathlib import Path

from PIL import Image

from ...formats.scene.bundle import Material
from ..scan.record import ScanMaterial


def write_materials(
    materials: tuple[ScanMaterial, ...], root: Path, max_px: int
) -> tuple[Material, ...]:
    """Write each image once under `root`/textures as PNG or JPEG, no larger than `max_px`.

    Images that were JPEG (photographs) stay JPEG; everything else is lossless.
    """
    folder = root / "textures"
    folder.mkdir(parents=True, exist_ok=True)
    written: dict[int, str] = {}
    result = []
    for material in materials:
        name = None
        if material.image is not None:
            key = id(material.image)
            if key not in written:
                written[key] = _write(material.image, folder, len(written), max_px)
            name = written[key]
        result.append(Material(material.name, material.base_color, name))
    return tuple(result)


def _write(image: Image.Image, folder: Path, index: int, max_px: int) -> str:
    jpeg = image.format == "JPEG"
    picture = image.convert("RGB")
    largest = max(picture.size)
    if largest > max_px:
        scale = max_px / largest
        size = (max(1, round(picture.width * scale)), max(1, round(picture.height * scale)))
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    path = folder / f"{index:03d}{'.jpg' if jpeg else '.png'}"
    if jpeg:
        picture.save(path, quality=92)
    else:
        # Level 1 compresses photographs nearly as well as 6 in a third of the time.
        picture.save(path, compress_level=1)
    return f"textures/{path.name}"
