"""Conversion of a scene's mesh and materials to arrays for kernels."""

import numpy as np

from ...formats.core.arrays import F32, Array, Mask
from ...formats.core.geometry import triangle_areas
from ...formats.scene.bundle import VisualMesh
from ...geometry.rays.packets import aligned
from ..kernels.data import SceneArrays
from .textures import MaterialTable

# A scan's atlas uses each texel at one place, so that its triangles cover the texture at most once;
# the margin allows for overlapping borders.
MAX_ATLAS_COVER = 1.5
FLATNESS_SAMPLES = 50_000


def scene_arrays(mesh: VisualMesh, materials: MaterialTable, relit: bool = False) -> SceneArrays:
    """Build the arrays and decide which materials are lit.

    A light that relights a scene lights everything. Otherwise plain colours are always lit, while
    textures contain the light of the scanned room and are shown unchanged. If most of the scene's
    textured area cannot contain light, the scene was drawn rather than scanned, its textures are
    surface colours, and all of it is lit.
    """
    textured = materials.texture >= 0
    drawn = relit or drawn_share(mesh, materials) > 0.5
    return SceneArrays(
        face=_face_records(mesh),
        base_linear=materials.base_linear,
        texture=materials.texture,
        shaded=~textured | drawn,
        pack=materials.pack,
    )


def _face_records(mesh: VisualMesh) -> F32:
    """Return (F, 16) as described at `SceneArrays.face`."""
    records = aligned((len(mesh.faces), 16))
    corner = mesh.vertices[mesh.faces]
    uv = mesh.corner_uv
    e, g = (corner[:, k].astype(np.float64) - corner[:, 0] for k in (1, 2))
    normal = np.cross(e, g)
    square = np.einsum("fi,fi->f", normal, normal)[:, None]
    with np.errstate(divide="ignore"):
        scale = np.where(square > 0.0, 1.0 / square, 0.0)
    # Gradients of the barycentric coordinates on the triangle's plane.
    along_u, along_v = np.cross(g, normal) * scale, np.cross(normal, e) * scale
    for k in range(2):
        steps = (uv[:, corner_, k] - uv[:, 0, k] for corner_ in (1, 2))
        first, second = (step[:, None].astype(np.float64) for step in steps)
        records[:, 3 * k : 3 * k + 3] = along_u * first + along_v * second
    records[:, 6:8] = uv[:, 0]
    records[:, 8:10] = uv[:, 1] - uv[:, 0]
    records[:, 10:12] = uv[:, 2] - uv[:, 0]
    records[:, 12] = mesh.face_material
    return records


def drawn_share(mesh: VisualMesh, materials: MaterialTable) -> float:
    """Return the share of the textured area (0–1) whose textures cannot contain a room's light.

    There the same texel is used at several places (tiles, repeated parts, several objects with one
    image), or the texture is a single flat colour.
    """
    corner = mesh.vertices[mesh.faces].astype(np.float64)
    area = triangle_areas(corner)
    texture = materials.texture[mesh.face_material]
    area = np.where(texture >= 0, area, 0.0)
    if area.sum() == 0.0:
        return 0.0
    cover = np.bincount(np.maximum(texture, 0), weights=np.where(texture >= 0, _uv_area(mesh), 0.0))
    repeated = cover[np.maximum(texture, 0)] > MAX_ATLAS_COVER
    flat = _is_flat(materials)[np.maximum(texture, 0)]
    return float(area[repeated | flat].sum() / area.sum())


def _uv_area(mesh: VisualMesh) -> Array:
    uv = mesh.corner_uv.astype(np.float64)
    e, g = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return 0.5 * np.abs(e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0])


def _is_flat(materials: MaterialTable) -> Mask:
    """Return (T,) whether a texture has a single colour, up to compression noise."""
    pack = materials.pack
    flat = np.zeros(max(len(pack.levels), 1), dtype=bool)
    for t in range(len(pack.levels)):
        texels = pack.level(t, 0).ravel()
        texels = texels[:: max(1, len(texels) // FLATNESS_SAMPLES)]
        roots = np.stack([(texels >> shift) & 1023 for shift in (0, 10, 20)])
        flat[t] = bool((roots.std(axis=-1) < 0.01 * 1023).all())
    return flat
