"""Bake the texture pages: exact colour times light."""

from dataclasses import dataclass

import cv2
import numpy as np

from ...formats.core.arrays import F32, I32, I64, U8, Array
from ...formats.core.geometry import triangle_normals
from ...formats.process.kernel import kernel
from ...formats.process.threads import in_order
from ...geometry.fusion.surface import ScanMesh, sums, unit
from ..building.true_scene import TrueScene
from ..config import ScanConfig
from .appearance import Appearance
from .atlas import Charts, Packing
from .light import Lighting, exposed
from .lookup import exact_surface
from .raster import rasterize
from .tracing import Tracer

_CHUNK = 1 << 18


@dataclass(frozen=True)
class ChartVertices:
    """The mesh's vertices once per chart they occur in.

    Attributes:
        vertex: (N,) vertex of the mesh.
        face: (F, 3) int32 index into these.
        normal: (N, 3) float32 unit normals within the chart.
    """

    vertex: I64
    face: I32
    normal: F32


def chart_vertices(mesh: ScanMesh, charts: Charts) -> ChartVertices:
    """Split vertices at chart borders."""
    count = len(mesh.vertices)
    key = charts.chart[:, None].astype(np.int64) * count + mesh.faces
    unique, index = np.unique(key, return_inverse=True)
    face = index.reshape(-1, 3).astype(np.int32)
    _, area = mesh.normals()
    weighted = np.repeat(charts.normal * area[:, None], 3, axis=0)
    normal = unit(sums(face.ravel(), weighted, len(unique)))
    return ChartVertices(unique % count, face, normal.astype(np.float32))


class Baker:
    """Bakes the pages of one scan."""

    def __init__(
        self, rng: np.random.Generator, scene: TrueScene, tracer: Tracer, config: ScanConfig
    ):
        self._tracer, self._rays = tracer, config.light_rays
        self._surface = Appearance.of(scene)
        self._normals = triangle_normals(scene.shape.corners).astype(np.float32)
        self._light = Lighting(rng, scene, tracer, self._surface)
        self._rng = rng

    def vertex_light(self, mesh: ScanMesh, split: ChartVertices) -> F32:
        """Return soft light (N, 3) at chart vertices, smoothed along the mesh."""
        points = mesh.vertices[split.vertex].astype(np.float32)
        soft = self._light.soft(self._rng, points, split.normal, self._rays)
        light = soft.astype(np.float32)
        for _ in range(2):
            total = light * np.float32(2.0)
            weight = np.full(len(light), 2.0)
            for a, b in ((0, 1), (1, 2), (2, 0)):
                i, j = split.face[:, a], split.face[:, b]
                for here, there in ((i, j), (j, i)):
                    total += sums(here, light[there], len(light))
                    weight += np.bincount(here, minlength=len(light))
            light = (total / weight[:, None]).astype(np.float32)
        return light

    def page(
        self,
        mesh: ScanMesh,
        charts: Charts,
        split: ChartVertices,
        light: F32,
        packing: Packing,
        page: int,
    ) -> U8:
        """Bake the image (height, width, 3) of one page."""
        selected = np.flatnonzero(packing.page[charts.chart] == page)
        corner = page_corners(charts, packing)[selected]
        face, bary = rasterize(corner, packing.page_size[page])
        image = np.zeros((*face.shape, 3), dtype=np.uint8)
        flat_image, flat_face = image.reshape(-1, 3), face.ravel()
        flat_bary = bary.reshape(-1, 2)
        filled = np.flatnonzero(flat_face >= 0)
        points = mesh.vertices[mesh.faces[selected]].astype(np.float32)
        corner_light = light[split.face[selected]]
        normals = charts.normal[selected]

        def paint(first: int) -> None:
            part = filled[first : first + _CHUNK]
            position, normal, shade = np.empty((3, len(part), 3), dtype=np.float32)
            corners, texels = (points, normals, corner_light), (position, normal, shade)
            _spread(part, flat_face, flat_bary, corners, texels)
            flat_image[part] = self._texels(position, normal, shade)

        for _ in in_order(paint, range(0, len(filled), _CHUNK)):
            pass
        painted = face >= 0
        mean = np.array(cv2.mean(image, painted.view(np.uint8))[:3]).astype(np.uint8)
        np.copyto(image, mean, where=~painted[..., None])
        return image

    def _texels(self, position: F32, normal: F32, shade: F32) -> U8:
        hits = exact_surface(self._tracer, position, normal)
        color = self._surface.color(hits.prim, hits.bary).astype(np.float32)
        exact = self._normals.take(hits.prim, axis=0)
        exact *= np.sign(np.einsum("ij,ij->i", exact, normal) + 1e-9)[:, None]
        total = shade + self._light.sun(position, exact)
        # Light adds up linearly while the textures are gamma-coded.
        factor = exposed(total)
        factor[self._surface.emissive[self._surface.material[hits.prim]]] = 1.0
        return np.clip(color * factor, 0, 255).astype(np.uint8)


def page_corners(charts: Charts, packing: Packing) -> Array:
    """Return corners (F, 3, 2) on their pages [texels, y down]."""
    return charts.corner + packing.origin[charts.chart][:, None]


@kernel()
def _spread(texels, face, bary, corners, out):
    """Interpolate what triangles have at their corners to the texels in them.

    Args:
        texels: (N,) index of each texel.
        face: triangle in each texel of the page.
        bary: weights (…, 2) of the second and third corner there, beyond 0…1 beside the triangle.
        corners: positions (F, 3, 3), normals (F, 3) and light (F, 3, 3) of the triangles.
        out: position, normal and light (N, 3) of the texels, written.
    """
    points, normals, light = corners
    position, normal, shade = out
    for i in range(len(texels)):
        f = face[texels[i]]
        b, c = bary[texels[i], 0], bary[texels[i], 1]
        a = np.float32(1.0) - b - c
        # Light is not extrapolated.
        within = min(max(a, 0.0), 1.0), min(max(b, 0.0), 1.0), min(max(c, 0.0), 1.0)
        for k in range(3):
            position[i, k] = a * points[f, 0, k] + b * points[f, 1, k] + c * points[f, 2, k]
            normal[i, k] = normals[f, k]
            shade[i, k] = (
                within[0] * light[f, 0, k] + within[1] * light[f, 1, k] + within[2] * light[f, 2, k]
            )
