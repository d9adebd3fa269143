"""Merge the parts that a reader found into one triangle soup; bake vertex colours into textures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...formats.core.arrays import F32, I64, U8, Array, Mask
from ...formats.core.geometry import coarse_warning, far_offset, triangle_areas
from .record import Scan, ScanMaterial, ScanObject

# Coordinates beyond this are damage, not distance …
MAX_COORDINATE = 1e11
# … and so is what lies further from a scan's middle: it would ruin every bounding box.
MAX_AWAY = 1e7
# A triangle's tile: corners sit at texel centres (1, 1), (2, 1), (1, 2) of 4 × 4 texels; the
# ring around them keeps coarser filters inside the tile.
TILE = 4
BLOCK = 65_536
# One image holds no more, so that it stays within the size at which textures are scaled down.
MAX_FACES = (4096 // TILE) ** 2


@dataclass(frozen=True)
class Part[M]:
    """Triangles of one node that share one material, or a reference to it.

    Attributes:
        name: the object they belong to; parts of one object share it.
        category: what that object is; empty = unknown, then it makes no object.
        vertices: (V, 3) float, source coordinates.
        faces: (F, 3) integers below V.
        uv: (F, 3, 2) float32; v up.
        colors: (F, 3, 3) uint8 sRGB at the corners, taking the place of the look's colour.
    """

    name: str
    category: str
    vertices: NDArray[Any]
    faces: NDArray[Any]
    uv: F32
    material: M
    colors: U8 | None = None


ScanPart = Part[ScanMaterial]


def merge_parts(
    parts: Sequence[ScanPart],
    warnings: list[str],
    up: tuple[str, str] | None = None,
    unit: tuple[str, str] | None = None,
) -> Scan:
    """Merge parts into one scan; drop unusable faces with a warning."""
    materials: dict[Any, int] = {}
    distinct: list[ScanMaterial] = []
    objects: dict[str, int] = {}
    names: dict[str, int] = {}
    named: list[ScanObject] = []
    uvs: list[F32] = []
    of_material, of_object, of_name = [], [], []
    parts = [piece for part in parts for piece in _split_for_baking(part)]
    for part in parts:
        material, uv = part.material, part.uv
        if part.colors is not None:
            image, uv = bake_corner_colors(part.colors)
            material = ScanMaterial(material.name, (1.0, 1.0, 1.0), image)
        key = (id(material.image) if material.image is not None else None, material.base_color)
        if key not in materials:
            materials[key] = len(distinct)
            distinct.append(material)
        if part.category and part.name not in objects:
            objects[part.name] = len(named)
            named.append(ScanObject(part.name, part.category))
        of_name.append(names.setdefault(part.name, len(names)))
        uvs.append(uv)
        of_material.append(materials[key])
        of_object.append(objects[part.name] if part.category else -1)
    sizes = np.array([len(part.faces) for part in parts])
    offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([np.asarray(p.vertices, dtype=np.float64) for p in parts])
    faces = np.concatenate(
        [np.asarray(p.faces, dtype=np.int64) + o for p, o in zip(parts, offsets, strict=False)]
    )
    corner_uv = np.concatenate(uvs).astype(np.float32, copy=False)
    offset = far_offset(vertices)
    if offset.any():
        warnings += coarse_warning(vertices, offset)
        warnings.append(
            f"lies far from the origin: {', '.join(f'{v:.0f}' for v in offset)} was subtracted "
            "(scene.json keeps it, and positions in either frame follow from source_to_world)"
        )
        vertices = vertices - offset
    scan = Scan(
        vertices=vertices,
        faces=faces,
        corner_uv=corner_uv,
        face_material=np.repeat(np.array(of_material, dtype=np.int32), sizes),
        face_object=np.repeat(np.array(of_object, dtype=np.int32), sizes),
        materials=tuple(distinct),
        objects=tuple(named),
        parts=tuple(names),
        face_part=np.repeat(np.array(of_name, dtype=np.int32), sizes),
        offset=offset,
        up=up,
        unit=unit,
    )
    usable = _usable_faces(vertices, faces, warnings)
    if not usable.all():
        scan = scan.take_faces(usable)
    vertices, faces = weld(vertices, scan.faces)
    return replace(scan, vertices=vertices, faces=faces, warnings=tuple(warnings))


def _split_for_baking(part: ScanPart) -> list[ScanPart]:
    """Split a part so that one image can hold the colours of its faces."""
    if part.colors is None or len(part.faces) <= MAX_FACES:
        return [part]
    colors = part.colors
    cuts = [slice(k, k + MAX_FACES) for k in range(0, len(part.faces), MAX_FACES)]
    return [
        replace(part, faces=part.faces[cut], uv=part.uv[cut], colors=colors[cut]) for cut in cuts
    ]


def _usable_faces(vertices: Array, faces: I64, warnings: list[str]) -> Mask:
    finite = np.all(np.isfinite(vertices) & (np.abs(vertices) < MAX_AWAY), axis=1)
    keep = finite[faces].all(axis=1)
    if not keep.all():
        warnings.append(f"{int((~keep).sum())} faces with invalid coordinates dropped")
    with np.errstate(invalid="ignore", over="ignore"):
        degenerate = keep & ~(triangle_areas(vertices[faces]) > 0)
    if degenerate.any():
        warnings.append(f"{int(degenerate.sum())} faces without area dropped")
    return keep & ~degenerate


def weld(vertices: Array, faces: I64) -> tuple[Array, I64]:
    """Merge vertices at bitwise equal positions, drop unused ones; faces keep their order."""
    used, inverse = np.unique(faces, return_inverse=True)
    points = vertices[used] + 0.0  # −0.0 and 0.0 are one place
    order = np.lexsort(points.T)
    ordered = points[order]
    new = np.ones(len(ordered), dtype=bool)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    group = np.empty(len(points), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    return ordered[new], group[inverse].reshape(faces.shape)


def bake_corner_colors(colors: U8) -> tuple[Image.Image, F32]:
    """Bake ramps of corner colours (F, 3, 3) into one image; return it and corner uv (F, 3, 2).

    Bilinear lookup between three texel centres is the barycentric ramp, if the fourth texel
    continues the plane through the three. v is up.
    """
    count = len(colors)
    columns = max(1, int(np.ceil(np.sqrt(count))))
    rows = -(-count // columns)
    sheet = np.zeros((rows * columns, TILE, TILE, 3), dtype=np.uint8)
    # In blocks: as numbers with fractions the whole sheet would be ten times larger.
    for start in range(0, count, BLOCK):
        tiles = _tiles(colors[start : start + BLOCK])
        sheet[start : start + len(tiles)] = tiles
    pixels = sheet.reshape(rows, columns, TILE, TILE, 3).swapaxes(1, 2)
    pixels = pixels.reshape(rows * TILE, columns * TILE, 3)
    index = np.arange(count)
    origin = np.stack([index % columns, index // columns], axis=-1) * TILE
    texel = origin[:, None, :] + np.array([[1.5, 1.5], [2.5, 1.5], [1.5, 2.5]])
    uv = texel / (columns * TILE, rows * TILE)
    uv[..., 1] = 1.0 - uv[..., 1]
    return Image.fromarray(pixels), uv.astype(np.float32)


def _tiles(colors: U8) -> U8:
    """Return the tiles (n, TILE, TILE, 3) of triangles with corner colours (n, 3, 3)."""
    corner = colors.astype(np.float32)
    steps = np.arange(TILE, dtype=np.float32) - 1
    across = (corner[:, 1] - corner[:, 0])[:, None, None]
    down = (corner[:, 2] - corner[:, 0])[:, None, None]
    tile = corner[:, 0][:, None, None] + across * steps[None, None, :, None]
    tile = tile + down * steps[None, :, None, None]
    return np.clip(np.rint(tile), 0, 255).astype(np.uint8)
