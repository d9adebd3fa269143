"""The renderer for graphics cards: MuJoCo draws through EGL, our light is applied to its picture.

MuJoCo's renderer gives the surfaces' own colours and the depth of each pixel's centre in one pass;
the same light as the other renderer's is then computed per pixel. Without a graphics card the same
code runs on Mesa's llvmpipe.
"""

import cv2
import numpy as np

from ...formats.core.arrays import F32, U8, Array, Mask
from ...formats.core.frames import quat_to_matrix
from ...formats.scene.bundle import SceneBundle, VisualMesh
from ..frame import Drawn, RenderRequest
from ..interface import Renderer
from ..kernels.data import Hits, LightArrays
from ..kernels.shading import light_pixels
from ..kernels.srgb import decode_table
from ..light.contact_shadow import ContactShadow
from ..scene.robot_body import GeomSurface, RobotGeometryPose, bounding_boxes
from ..scene.robot_trace import HOUSING_MARGIN_M
from ..scene.textures import MaterialTable
from ..scene_tracer import pixel_directions
from .draw import HIDDEN_GROUP, NEAR_M, DrawnView, GlContext, ModelDrawer, gl_context
from .model import robot_model, scene_pieces

SHADOW_OFFSET_M = 0.005  # distance of a shadow ray's origin from the surface
# What a pixel shows: nothing, a surface that is not lit, one that is lit, the robot.
NO_SURFACE, UNLIT, LIT, ON_ROBOT = 0, 1, 2, 3


class GlRenderer(Renderer):
    """RGB and depth of one scene through OpenGL."""

    name = "gl"

    def __init__(self, bundle: SceneBundle, light: str = "baked"):
        """Load the mesh and textures and hand them to OpenGL.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
            FileFormatError: the mesh or a texture cannot be read.
            InputError: no OpenGL context can be created through EGL; the message says why.
        """
        self._context = gl_context()
        self._robot: _RobotDrawer | None = None
        self._decode = decode_table()
        super().__init__(bundle, light)

    def _prepare(self, mesh: VisualMesh, materials: MaterialTable) -> None:
        pieces = scene_pieces(mesh, materials)
        self._corners_m = pieces.corners_m
        self._lit = self._scene.arrays.shaded[pieces.material]
        self._drawer = ModelDrawer(self._context, pieces.model)
        self._drawer.upload(pieces.textures)

    @property
    def device(self) -> str:
        """Name of the device that draws: a graphics card, or `llvmpipe`."""
        return self._context.device

    def _draw(self, request: RenderRequest) -> Drawn:
        camera = request.camera
        seen, near_m, far_m = _in_view(self._corners_m, request)
        self._drawer.model.geom_group[:] = np.where(seen, 0, HIDDEN_GROUP)
        view = DrawnView(request, near_m, far_m, request.cut_above_m)
        rgb, depth = self._drawer.draw(view)
        state = np.where(depth > 0, UNLIT, NO_SURFACE).astype(np.uint8)
        if self._lit.all():
            state *= LIT
        elif self._lit.any():
            state[self._lit[self._drawer.geoms(view)] & (depth > 0)] = LIT
        spheres = None
        if request.robot is not None:
            if self._robot is None or self._robot.surfaces is not request.robot.surfaces:
                self._robot = _RobotDrawer(self._context, request.robot.surfaces)
            body = self._robot.draw(request.robot, request)
            if body is not None:
                spheres = self._robot.shadow.posed(request.robot)
                front = (body[1] > 0) & ((body[1] < depth) | (depth == 0))
                rgb[front], depth[front], state[front] = body[0][front], body[1][front], ON_ROBOT
        lighting = self._scene.lighting(request, spheres)
        directions = pixel_directions(request)
        color = np.empty((depth.size, 3), dtype=np.float32)
        flat = rgb.reshape(-1, 3)
        light_pixels(
            flat, depth.ravel(), state.ravel(), camera.width_px, camera.height_px,
            directions, request.position.astype(np.float32), self._decode, lighting.light,
            self._lamp_gain(lighting.light, request, directions, depth, state),
            lighting.spheres, color,
        )  # fmt: skip
        self._scene.encode(color, flat)
        # Edges are smoothed by rays: OpenGL's several samples a pixel would blur the depth or need
        # a second pass. The robot's outline stays as it was drawn.
        robot = state == ON_ROBOT
        beside = cv2.dilate(robot.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        surface = state.ravel().astype(np.int32)
        centers = Hits(color, depth.ravel(), surface, np.full_like(surface, -1))
        self._scene.smooth_edges(flat, centers, request, lighting, skip=beside.ravel())
        return Drawn(rgb, depth, robot, None)

    def _lamp_gain(
        self,
        light: LightArrays,
        request: RenderRequest,
        directions: F32,
        depth: F32,
        state: U8,
    ) -> F32:
        """Return (H · W,) 0 in the lamp's shadow, else 1; (0,) when the lamp casts none."""
        if not (light.lamp_apart and light.lamp[6] > 0):
            return np.zeros(0, dtype=np.float32)
        gain = np.ones(depth.size, dtype=np.float32)
        lit = np.flatnonzero(state.ravel() == LIT)
        reach = depth.ravel()[lit, None] - SHADOW_OFFSET_M
        points = (request.position + directions[lit] * reach).astype(np.float32)
        toward = (light.lamp[:3] - points).astype(np.float32)
        gain[lit[self._scene.rays.occluded(origins=points, directions=toward)]] = 0.0
        return gain


class _RobotDrawer:
    """Draws one robot's body."""

    def __init__(self, context: GlContext, surfaces: tuple[GeomSurface, ...]):
        self.surfaces = surfaces
        self.shadow = ContactShadow(surfaces)
        self._drawer = ModelDrawer(context, robot_model(surfaces))
        model = self._drawer.model
        # MuJoCo moves meshes to their centres and turns them along their axes.
        self._moved, self._turned = model.geom_pos.copy(), quat_to_matrix(model.geom_quat)
        self._box = bounding_boxes(surfaces)

    def draw(self, pose: RobotGeometryPose, request: RenderRequest) -> tuple[U8, F32] | None:
        """Return colours and depth of the posed body; None when it is out of view."""
        at, turn = pose.position_world_m, pose.rotation_world
        corners = np.einsum("gij,gkj->gki", turn, self._box) + at[:, None]
        seen, near_m, far_m = _in_view(corners, request)
        inside = np.einsum("gji,gj->gi", turn, request.position - at)
        for k in np.flatnonzero(seen):  # a lens sits on the surface of its housing
            seen[k] = not self.surfaces[k].holds(inside[k], HOUSING_MARGIN_M)
        if not seen.any():
            return None
        model, data = self._drawer.model, self._drawer.data
        model.geom_group[:] = np.where(seen, 0, HIDDEN_GROUP)
        data.geom_xpos[:] = at + np.einsum("gij,gj->gi", turn, self._moved)
        data.geom_xmat[:] = (turn @ self._turned).reshape(-1, 9)
        return self._drawer.draw(DrawnView(request, near_m, far_m))


def _in_view(corners_m: Array, request: RenderRequest) -> tuple[Mask, float, float]:
    """Return which boxes (G, 8, 3) the camera may see (G,), and their least and greatest z [m]."""
    camera = request.camera
    x, y, z = np.moveaxis((corners_m - request.position) @ request.rotation, -1, 0)
    right = 0.5 * camera.width_px / camera.focal_px
    down = 0.5 * camera.height_px / camera.focal_px
    seen = (z > 0).any(1)
    for side, slope in ((x, right), (-x, right), (y, down), (-y, down)):
        seen &= (side < slope * z).any(1)
    if not seen.any():
        return seen, NEAR_M, 1.0
    far = max(float(z[seen].max()) * 1.01, 2 * NEAR_M)
    return seen, float(np.clip(0.99 * z[seen].min(), NEAR_M, 0.5 * far)), far
