"""The renderer of scenes captured as Gaussian splats: colours from splats, depth from the mesh.

Splats are blended over a backdrop: the repaired mesh, which shows where no splat is (a filled hole
in the floor, the sky), and the robot, which hides the splats behind it. Labels are those of the
mesh that was fused from the splats. So is depth, metric as in every other scene, or it is the mean
over what a pixel shows (`SplatDepthRenderer`).
"""

import logging
from typing import ClassVar

import numpy as np

from ..formats.core.arrays import F32, U8
from ..formats.core.errors import InputError
from ..formats.scene.bundle import SceneBundle
from ..formats.splats.store import has_splats, load_splats
from ..geometry.splatting.backend import make_drawer
from ..geometry.splatting.draw import Eye, SplatImage
from .frame import Drawn, RenderRequest
from .interface import Renderer
from .kernels.data import Hits
from .kernels.shading import light_pixels
from .kernels.srgb import decode_table
from .scene.robot_trace import RobotTracer
from .scene_tracer import Lighting, pixel_directions

BAKED = "baked"
# Splats scatter around the surface they stand for: a foot on the floor is not hidden by what is
# nearer by less than this, nor a robot by a mesh.
SCATTER_M = 0.03
NO_SURFACE, UNLIT = 0, 1
# Splats before nothing have a depth if they take at least this share of the light.
ALONE = 0.5

log = logging.getLogger(__name__)


class SplatRenderer(Renderer):
    """RGB by splatting, on the GPU where gsplat is; depth by ray tracing.

    Attributes:
        expected_depth: whether depth is that of the splats.
    """

    name = "splat"
    expected_depth: ClassVar[bool] = False

    def __init__(self, bundle: SceneBundle, light: str = BAKED):
        """Load mesh, textures and splats.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
            FileFormatError: the mesh, a texture or the splats cannot be read.
            InputError: the scene has no splats, or the light is another than `baked`.
        """
        if not has_splats(bundle.root):
            raise InputError(
                f"renderer {self.name}: {bundle.scene_id} has no Gaussian splats; valid: embree, gl"
            )
        if light != BAKED:
            raise InputError(
                f"light {light}: {bundle.scene_id} is made of Gaussian splats, which keep the light"
                f" of their capture; valid: {BAKED} (or --renderer embree, which draws its mesh)"
            )
        super().__init__(bundle, light)
        self._splats = make_drawer(load_splats(bundle.root))
        log.info("splats are drawn by %s", self._splats.name)
        self._robot = RobotTracer()
        self._decode = decode_table()

    def _draw(self, request: RenderRequest) -> Drawn:
        camera = request.camera
        shape = camera.height_px, camera.width_px
        directions = pixel_directions(request)
        lighting = self._scene.lighting(request)
        order = self._scene.pixel_order(camera)
        mesh = self._scene.trace(directions, order, request, lighting)
        geoms, spheres = self._robot.visible(request)
        body = Hits.nothing(len(directions))
        self._robot.trace_pixels(geoms, directions, request, lighting.light, body)
        robot = body.depth < mesh.depth + SCATTER_M
        backdrop = np.empty((len(directions), 3), dtype=np.uint8)
        self._scene.encode(np.where(robot[:, None], body.color, mesh.color), backdrop)
        cover = np.where(robot, body.depth - np.float32(SCATTER_M), np.float32(np.inf))
        eye = Eye(camera, request.position, request.rotation)
        image = self._splats.draw(
            eye, cover.reshape(shape), request.cut_above_m, with_depth=self.expected_depth
        )
        through = image.light[..., None]
        mixed = 255 * image.color + through * backdrop.reshape(*shape, 3)
        rgb = np.clip(mixed + np.float32(0.5), 0, 255).astype(np.uint8)
        depth = np.where(robot, body.depth, mesh.depth)
        depth[np.isinf(depth)] = 0.0
        if self.expected_depth:
            depth = expected_depth(image, depth.reshape(shape)).ravel()
        if len(spheres):
            shaded = self._shaded(rgb, mesh.depth, request, directions, lighting, spheres)
            front = robot.reshape(shape) & (image.light > 0)
            # What the robot shows of itself keeps its own light.
            share = np.where(front, image.light, 0)[..., None]
            rgb = (shaded + share * (rgb.astype(np.float32) - shaded) + 0.5).astype(np.uint8)
        return Drawn(
            rgb,
            depth.reshape(shape),
            robot.reshape(shape),
            np.where(robot, -1, mesh.prim).reshape(shape).astype(np.int32),
        )

    def _shaded(
        self,
        rgb: U8,
        depth: F32,
        request: RenderRequest,
        directions: F32,
        lighting: Lighting,
        spheres: F32,
    ) -> U8:
        """Return an image darkened around the robot, on the surface that `depth` (N,) gives."""
        surface = np.isfinite(depth)
        color = np.empty((len(depth), 3), dtype=np.float32)
        flat = rgb.reshape(-1, 3)
        light_pixels(
            flat, np.where(surface, depth, 0).astype(np.float32),
            np.where(surface, UNLIT, NO_SURFACE).astype(np.uint8),
            request.camera.width_px, request.camera.height_px, directions,
            request.position.astype(np.float32), self._decode, lighting.light,
            np.zeros(0, dtype=np.float32), spheres, color,
        )  # fmt: skip
        shaded = np.empty_like(flat)
        self._scene.encode(color, shaded)
        shaded[~surface] = flat[~surface]
        return shaded.reshape(rgb.shape)


class SplatDepthRenderer(SplatRenderer):
    """Colours and depth by splatting."""

    name = "splat_depth"
    expected_depth = True


def expected_depth(image: SplatImage, behind_m: F32) -> F32:
    """Return the mean depth (H, W) of what each pixel shows [m], 0 = nothing.

    Each Gaussian counts by its share of the pixel's light, and the backdrop by what gets through.

    Args:
        image: the splats, with their mean depth.
        behind_m: (H, W) depth of mesh and robot [m], 0 = none; there the splats count alone, if
            they take at least half of the light.
    """
    covered = 1 - image.light
    alone = np.where(covered >= ALONE, image.depth_m, 0)
    both = covered * image.depth_m + image.light * behind_m
    return np.where(behind_m > 0, both, alone).astype(np.float32)
