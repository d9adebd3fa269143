"""The default renderer: Embree traces, numba shades; no GPU, no display."""

import numpy as np

from ..formats.core.arrays import F32, I32, I64
from ..formats.scene.bundle import SceneBundle
from .camera.rays import SUBPIXELS
from .frame import NOTHING, Drawn, RenderRequest
from .interface import Renderer
from .kernels.data import Hits
from .scene.robot_trace import RobotTracer, VisibleGeom
from .scene_tracer import pixel_directions


class SceneRenderer(Renderer):
    """RGB and depth of one scene by ray tracing.

    One ray per pixel gives depth and colour; pixels on visible edges get three rays more for their
    colour, while their depth stays that of the centre.
    """

    name = "embree"

    def __init__(self, bundle: SceneBundle, light: str = "baked"):
        """See `Renderer`."""
        super().__init__(bundle, light)
        self._directions = np.empty((0, 3), dtype=np.float32)
        self._robot = RobotTracer()

    def _draw(self, request: RenderRequest) -> Drawn:
        width, height = request.camera.width_px, request.camera.height_px
        count = width * height
        if len(self._directions) != count:
            self._directions = np.empty((count, 3), dtype=np.float32)
        directions = pixel_directions(request, self._directions)
        geoms, spheres = self._robot.visible(request)
        lighting = self._scene.lighting(request, spheres)
        order = self._scene.pixel_order(request.camera)
        hits = self._scene.trace(directions, order, request, lighting)
        self._robot.trace_pixels(geoms, directions, request, lighting.light, hits)
        hits.depth[np.isinf(hits.depth)] = 0.0
        rgb = np.empty((count, 3), dtype=np.uint8)
        self._scene.encode(hits.color, rgb)

        def add_robot(pixels: I32, directions: F32, samples: Hits) -> None:
            for geom in geoms:
                rays = _samples_inside(geom, pixels, width)
                self._robot.trace(geom, rays, directions, request.position, lighting.light, samples)

        self._scene.smooth_edges(rgb, hits, request, lighting, overlay=add_robot)
        shape = height, width
        return Drawn(
            rgb.reshape(*shape, 3),
            hits.depth.reshape(shape),
            (hits.surface < NOTHING).reshape(shape),
            hits.prim.reshape(shape),
        )


def _samples_inside(geom: VisibleGeom, pixels: I32, width: int) -> I64:
    """Return the samples of those `pixels` (K,) that a geom can cover, as indices."""
    left, top, right, bottom = geom.rectangle_px
    rows, columns = np.divmod(pixels, width)
    inside = (rows >= top) & (rows < bottom) & (columns >= left) & (columns < right)
    return np.flatnonzero(np.repeat(inside, len(SUBPIXELS)))
