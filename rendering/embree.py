"""The default renderer: Embree traces, numba shades; no GPU, no display."""

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..formats.core.arrays import F32, I32, I64, U8
from ..formats.core.camera import CameraModel
from ..formats.scene.bundle import SceneBundle
from .camera.rays import SUBPIXELS
from .frame import NOTHING, Drawn, RenderRequest
from .interface import Renderer
from .kernels.data import Hits
from .scene.robot_body import RobotGeometryPose
from .scene.robot_trace import RobotTracer, VisibleGeom
from .scene_tracer import pixel_directions

FINER = 2  # pixels of a drawing per pixel of the side to which its reader shrinks it, at least


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

    def render_for(
        self,
        side_px: int,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
    ) -> tuple[U8, F32]:
        """See `Renderer.render_for`: RGB of fewer pixels, and one ray for each depth picked."""
        request = RenderRequest(
            _smaller(camera, FINER * side_px), position_world_m, quat_wxyz, robot, np.inf, None
        )
        if request.camera == camera:
            return self.render(camera, position_world_m, quat_wxyz, robot)
        geoms, spheres = self._robot.visible(request)
        drawn = self._draw_with(request, geoms, spheres)
        return drawn.rgb, self._picked_depth(side_px, camera, request, geoms)

    def _picked_depth(
        self, side: int, camera: CameraModel, request: RenderRequest, geoms: list[VisibleGeom]
    ) -> F32:
        """Return the depth (side, side) at the pixels of `camera` that a reader would pick."""
        width, height = camera.width_px, camera.height_px
        columns, rows = (_picked(n, side) for n in (width, height))
        x = (columns + 0.5 - 0.5 * width) / camera.focal_px
        y = (rows + 0.5 - 0.5 * height) / camera.focal_px
        right, down, ahead = request.rotation.T
        directions = right * x[:, None] + (down * y[:, None])[:, None] + ahead
        directions = directions.reshape(-1, 3).astype(np.float32)
        hits = Hits.nothing(len(directions))
        hits.depth[:] = self._scene.first_hits(request, directions).depth
        light = self._scene.lighting(request).light
        drawn = request.camera  # whose pixels the geoms' rectangles count
        columns = (2 * columns + 1) * drawn.width_px // (2 * width)
        rows = (2 * rows + 1) * drawn.height_px // (2 * height)
        for geom in geoms:
            left, top, right, bottom = geom.rectangle_px
            inside = ((rows >= top) & (rows < bottom))[:, None] & (columns >= left)
            rays = np.flatnonzero(inside & (columns < right))
            self._robot.trace(geom, rays, directions, request.position, light, hits)
        hits.depth[np.isinf(hits.depth)] = 0.0
        return hits.depth.reshape(side, side)

    def _draw(self, request: RenderRequest) -> Drawn:
        return self._draw_with(request, *self._robot.visible(request))

    def _draw_with(self, request: RenderRequest, geoms: list[VisibleGeom], spheres: F32) -> Drawn:
        width, height = request.camera.width_px, request.camera.height_px
        count = width * height
        if len(self._directions) != count:
            self._directions = np.empty((count, 3), dtype=np.float32)
        directions = pixel_directions(request, self._directions)
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


def _smaller(camera: CameraModel, side_px: int) -> CameraModel:
    """Return the smallest camera of the same aspect with sides of at least `side_px`, or itself."""
    steps = math.gcd(camera.width_px, camera.height_px)
    width, height = camera.width_px // steps, camera.height_px // steps
    count = min(-(-side_px // min(width, height)), steps)
    return replace(camera, width_px=count * width, height_px=count * height)


def _picked(count: int, side: int) -> I64:
    """Return those of `count` pixels in a row that a reader picks, (side,)."""
    row = np.arange(count, dtype=np.float32)[None]
    picked = cv2.resize(row, (side, 1), interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(picked[0], dtype=np.int64)


def _samples_inside(geom: VisibleGeom, pixels: I32, width: int) -> I64:
    """Return the samples of those `pixels` (K,) that a geom can cover, as indices."""
    left, top, right, bottom = geom.rectangle_px
    rows, columns = np.divmod(pixels, width)
    inside = (rows >= top) & (rows < bottom) & (columns >= left) & (columns < right)
    return np.flatnonzero(np.repeat(inside, len(SUBPIXELS)))
