"""A lit scene and its ray structure, as all renderers use them."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.arrays import F32, I32, U8, Mask
from ..formats.core.camera import CameraModel
from ..formats.scene.bundle import SceneBundle, VisualMesh
from ..geometry.rays.packets import TILES, PacketHits, PacketScene, tile_order
from .camera.rays import SUBPIXELS, fill_directions, list_order, subpixel_directions
from .frame import RenderRequest
from .kernels.data import Hits, LightArrays, Packets
from .kernels.edges import add_samples, find_edges, in_order
from .kernels.eye_rays import render_rays
from .kernels.srgb import encode_srgb, encode_table
from .light.contact_shadow import shadow_bounds
from .light.lights import get_light
from .light.scene_light import light_arrays, with_lamp
from .scene.arrays import scene_arrays
from .scene.textures import MaterialTable

MIN_CONTRAST = 24  # sRGB bytes; a smaller step is not seen as aliasing
EDGE_BEND = 0.4  # creases sharper than about 25° count as edges


class Lighting(NamedTuple):
    """The light of one frame.

    Attributes:
        light: the scene's light, with the lamp at its pose.
        spheres: (S, 4) centre and radius [m] of the robot's spheres, which darken nearby surfaces.
        reach: (2, 3) bounds of what they darken [m].
    """

    light: LightArrays
    spheres: F32
    reach: F32


class SceneTracer:
    """Traces and shades rays from the eye.

    Attributes:
        arrays: triangles, materials and textures for kernels.
        rays: ray structure of the triangles.
        label, thing: (F,) label and object of each triangle.
    """

    def __init__(self, bundle: SceneBundle, light: str, mesh: VisualMesh, materials: MaterialTable):
        """Build the ray structure and compute the light.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
        """
        kind = get_light(light)
        self.label, self.thing = mesh.face_label, mesh.face_object
        self.arrays = scene_arrays(mesh, materials, kind.relit)
        self.rays = PacketScene(mesh.vertices, mesh.faces)
        any_shaded = bool(self.arrays.shaded.any())
        self._light = light_arrays(kind, bundle, mesh, self.rays, any_shaded)
        self._lamp = kind.lamp
        self._packets = Packets.of(self.rays)
        self._encode = encode_table()

    def lighting(self, request: RenderRequest, spheres: F32 | None = None) -> Lighting:
        """Return the light of a frame; `spheres` as in `Lighting`, default none."""
        light = with_lamp(
            self._light,
            self._lamp,
            request.lamp_pose or (request.position, request.quat_wxyz),
            apart=request.lamp_pose is not None,
        )
        if spheres is None:
            spheres = np.zeros((0, 4), dtype=np.float32)
        return Lighting(light, spheres, shadow_bounds(spheres))

    def trace(
        self,
        directions: F32,
        order: I32,
        request: RenderRequest,
        lighting: Lighting,
        footprint_px: float = 1.0,
        reuse: tuple[I32, Hits] | None = None,
    ) -> Hits:
        """Trace rays from the eye and shade what they hit.

        Args:
            directions: (N, 3), world, of unit length along the optical axis.
            order: (P · lanes,) rays of each packet, −1 = an idle lane.
            footprint_px: side of each ray's footprint in the image [px].
            reuse: the ray (N,) next to each ray, and what those rays hit. Where both hit the same
                triangle, the colour is taken over.
        """
        count = len(directions)
        per_px = (footprint_px * request.rotation[:, :2] / request.camera.focal_px).T
        hits = Hits(
            np.empty((count, 3), dtype=np.float32),
            np.empty(count, dtype=np.float32),
            np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32),
        )
        near, seen = reuse or (np.empty(0, dtype=np.int32), hits)
        render_rays(
            order, directions, per_px.astype(np.float32), request.position.astype(np.float32),
            request.cut_above_m, self._packets, self.arrays, lighting.light, lighting.spheres,
            lighting.reach, near, seen, hits,
        )  # fmt: skip
        return hits

    def encode(self, color: F32, rgb: U8) -> None:
        """Write linear light (N, 3) as sRGB bytes to `rgb` (N, 3)."""
        encode_srgb(color, self._encode, rgb)

    def smooth_edges(
        self,
        rgb: U8,
        hits: Hits,
        request: RenderRequest,
        lighting: Lighting,
        *,
        skip: Mask | None = None,
        overlay: Callable[[I32, F32, Hits], None] | None = None,
    ) -> None:
        """Anti-alias visible edges of an image in place, by three more rays per pixel.

        Args:
            rgb: (N, 3) the image.
            hits: of the pixels' centres, nothing at depth 0; triangles −1 if they are not known.
            skip: (N,) pixels to leave as they are.
            overlay: called with the pixels (K,), the directions (3 K, 3) and hits of their rays, to
                put what is not part of the scene in front of it.
        """
        camera = request.camera
        width, height, focal = camera.width_px, camera.height_px, camera.focal_px
        marked = np.zeros(width * height, dtype=np.bool_)
        find_edges(
            rgb, hits.depth, hits.surface, hits.prim,
            width, height, EDGE_BEND / focal, MIN_CONTRAST, marked,
        )  # fmt: skip
        if skip is not None:
            marked &= ~skip
        order = self.pixel_order(camera)
        # Tile by tile, so that rays of a packet are close together.
        pixels = np.empty(len(order), dtype=np.int32)
        pixels = pixels[: in_order(order, marked, pixels)]
        if not len(pixels):
            return
        directions = subpixel_directions(pixels, SUBPIXELS, request.rotation, focal, width, height)
        order = list_order(len(directions), lanes=self._packets.size)
        near = np.repeat(pixels, len(SUBPIXELS))
        samples = self.trace(directions, order, request, lighting, 0.5, (near, hits))
        if overlay is not None:
            overlay(pixels, directions, samples)
        mixed = add_samples(samples.color, len(SUBPIXELS), pixels, hits.color)
        smooth = np.empty((len(pixels), 3), dtype=np.uint8)
        self.encode(mixed, smooth)
        rgb[pixels] = smooth

    def pixel_order(self, camera: CameraModel) -> I32:
        """Return the pixels of an image tile by tile, a packet of rays each; −1 = none."""
        return _pixel_order((camera.width_px, camera.height_px), self._packets.size)

    def triangles(self, request: RenderRequest) -> I32:
        """Return the triangle (H, W) at each pixel's centre, −1 = none."""
        prim = self.first_hits(request, pixel_directions(request)).prim
        return prim.reshape(request.camera.height_px, request.camera.width_px)

    def first_hits(self, request: RenderRequest, directions: F32) -> PacketHits:
        """Return what rays (N, 3) from the eye hit, without shading it."""
        origins = np.tile(request.position.astype(np.float32), (len(directions), 1))
        if request.position[2] > request.cut_above_m:
            down = np.minimum(directions[:, 2], np.float32(-1e-6))
            rise = np.float32(request.cut_above_m - request.position[2])
            origins += rise / down[:, None] * directions
        far = np.full(len(directions), np.inf, dtype=np.float32)
        return self.rays.trace(origins=origins, directions=directions, far=far)

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Return the distance [m] along a ray from (3,) towards (3,); inf when nothing is hit."""
        unit = np.asarray(direction_world, dtype=np.float64).reshape(1, 3)
        unit = (unit / np.linalg.norm(unit)).astype(np.float32)
        origin = np.asarray(origin_world_m, dtype=np.float32).reshape(1, 3)
        far = np.full(1, np.inf, dtype=np.float32)
        return float(self.rays.trace(origins=origin, directions=unit, far=far).depth[0])


def pixel_directions(request: RenderRequest, out: F32 | None = None) -> F32:
    """Return the world directions (H · W, 3) of the pixels' centres, written to `out` if given."""
    camera = request.camera
    if out is None:
        out = np.empty((camera.width_px * camera.height_px, 3), dtype=np.float32)
    fill_directions(request.rotation, camera.focal_px, camera.width_px, camera.height_px, out)
    return out


@functools.lru_cache(maxsize=8)
def _pixel_order(size_px: tuple[int, int], lanes_: int) -> I32:
    return tile_order(size_px, tile_px=TILES[lanes_])
