"""The renderer for graphics cards: MuJoCo draws through EGL, our light falls on what it drew.

MuJoCo's renderer gives the surfaces' own colours and the depth of each pixel's centre in one pass;
from these the same light as the other renderer's is worked out per pixel. Without a card the same
code runs on Mesa's llvmpipe.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....formats.core.camera import CameraModel
from ....formats.core.frames import quat_to_matrix
from ....formats.scene.bundle import SceneBundle
from ..camera.rays import SUBPIXELS, fill_directions, list_order, subpixel_directions
from ..embree import EDGE_BEND, MIN_CONTRAST, first_hit_m, pixel_order
from ..interface import NOTHING, ROBOT, Frame, Pose
from ..kernels.data import LightArrays, Packets
from ..kernels.drawn import light_pixels
from ..kernels.edges import add_samples, encode_srgb, find_edges
from ..kernels.eye_rays import render_rays
from ..kernels.packets import PacketScene, lanes, packet
from ..kernels.srgb import decode_table, encode_table
from ..light.contact_shadow import ContactShadow
from ..light.lights import get_light
from ..light.scene_light import light_arrays, with_lamp
from ..scene.arrays import scene_arrays
from ..scene.robot_body import GeomSurface, RobotGeometryPose
from ..scene.robot_trace import HOUSING_MARGIN_M
from ..scene.textures import load_materials
from .draw import HIDDEN_GROUP, NEAR_M, GlContext, ModelDrawer, gl_context
from .model import robot_model, scene_pieces

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
Array = NDArray[np.float64]

LAMP_LIFT_M = 0.005  # shadow rays start so far in front of what is lit


class GlRenderer:
    """RGB and depth of one scene; see `interface.Renderer`."""

    name = "gl"

    def __init__(self, bundle: SceneBundle, light: str = "baked"):
        """Load the mesh and textures and hand them to OpenGL.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
            FileFormatError: the mesh or a texture cannot be read.
            InputError: no OpenGL context can be had through EGL; the message says why.
        """
        self.light = light
        kind = get_light(light)
        self._context = gl_context()
        mesh = bundle.visual()
        materials = load_materials(bundle)
        self._arrays = scene_arrays(mesh, materials, kind.relit)
        shaded = self._arrays.shaded
        self._rays = PacketScene(mesh.vertices, mesh.faces)
        self._light = light_arrays(kind, bundle, mesh, self._rays, bool(shaded.any()))
        self._packets = Packets(self._rays.handle, self._rays.coherent, packet(), packet(), lanes())
        self._lamp = kind.lamp
        self._label, self._thing = mesh.face_label, mesh.face_object
        pieces = scene_pieces(mesh, materials)
        self._corners_m = pieces.corners_m
        self._lit = shaded[pieces.material]
        self._drawer = ModelDrawer(self._context, pieces.model)
        self._drawer.upload(pieces.textures)
        self._robot: _RobotDrawer | None = None
        self._decode, self._encode = decode_table(), encode_table()

    @property
    def device(self) -> str:
        """What draws: a graphics card, or `llvmpipe`."""
        return self._context.device

    def render(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> tuple[NDArray[np.uint8], F32]:
        """One frame: RGB (H, W, 3) uint8 sRGB and depth (H, W) float32 planar z [m], 0 = none.

        See `interface.Renderer.render`.
        """
        rgb, depth, _ = self._draw(
            camera, position_world_m, quat_wxyz, robot, cut_above_m, lamp_pose
        )
        return rgb, depth

    def render_labelled(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
        lamp_pose: Pose | None = None,
    ) -> Frame:
        """One frame with the labels and objects that its pixels show; see `interface.Renderer`.

        Triangles are named by rays through the pixels' centres, which meet what was drawn there.
        """
        rgb, depth, is_robot = self._draw(
            camera, position_world_m, quat_wxyz, robot, cut_above_m, lamp_pose
        )
        position = np.asarray(position_world_m, dtype=np.float64)
        directions = self._directions(camera, quat_to_matrix(quat_wxyz))
        origins = np.tile(position.astype(np.float32), (len(directions), 1))
        if position[2] > cut_above_m:
            down = np.minimum(directions[:, 2], np.float32(-1e-6))
            origins += np.float32(cut_above_m - position[2]) / down[:, None] * directions
        far = np.full(len(directions), np.inf, dtype=np.float32)
        prim = self._rays.trace(origins, directions, far).prim.reshape(depth.shape)
        label, thing = (
            np.where(is_robot, ROBOT, np.where(prim < 0, NOTHING, names[prim]))
            for names in (self._label, self._thing)
        )
        return Frame(rgb, depth, label.astype(np.int32), thing.astype(np.int32))

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Distance [m] along a ray to the scene, the robot apart; inf when nothing is hit."""
        return first_hit_m(self._rays, origin_world_m, direction_world)

    def _draw(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None,
        cut_above_m: float,
        lamp_pose: Pose | None,
    ) -> tuple[NDArray[np.uint8], F32, NDArray[np.bool_]]:
        """RGB (H, W, 3), depth (H, W), and where (H, W) the robot is."""
        position = np.asarray(position_world_m, dtype=np.float64)
        rotation = quat_to_matrix(quat_wxyz)
        seen, near, far = _in_view(self._corners_m, camera, position, rotation)
        self._drawer.model.geom_group[:] = np.where(seen, 0, HIDDEN_GROUP)
        rgb, depth = self._drawer.draw(camera, position, rotation, near, far, cut_above_m)
        state = np.where(depth > 0, 1, 0).astype(np.uint8)  # 0 nothing, 1 shown, 2 lit, 3 robot
        if self._lit.all():
            state *= 2
        elif self._lit.any():
            lit = self._lit[self._drawer.geoms(camera)] & (depth > 0)
            state[lit] = 2
        spheres = np.zeros((0, 4), dtype=np.float32)
        if robot is not None:
            if self._robot is None or self._robot.surfaces is not robot.surfaces:
                self._robot = _RobotDrawer(self._context, robot.surfaces)
            body = self._robot.draw(robot, camera, position, rotation)
            if body is not None:
                spheres = self._robot.shadow.posed(robot)
                front = (body[1] > 0) & ((body[1] < depth) | (depth == 0))
                rgb[front], depth[front], state[front] = body[0][front], body[1][front], 3
        light = with_lamp(self._light, self._lamp, position, quat_wxyz, lamp_pose)
        directions = self._directions(camera, rotation)
        color = np.empty((depth.size, 3), dtype=np.float32)
        light_pixels(
            rgb.reshape(-1, 3), depth.ravel(), state.ravel(), camera.width_px, camera.height_px,
            directions, position.astype(np.float32), self._decode, light,
            self._lamp_gain(light, position, directions, depth, state), spheres, color,
        )  # fmt: skip
        flat = rgb.reshape(-1, 3)
        encode_srgb(color, self._encode, flat)
        self._smooth(
            camera, position, rotation, light, spheres, cut_above_m, color, depth, state, flat
        )
        return rgb, depth, state == 3

    def _smooth(
        self,
        camera: CameraModel,
        position: Array,
        rotation: Array,
        light: LightArrays,
        spheres: F32,
        cut_above_m: float,
        color: F32,
        depth: F32,
        state: NDArray[np.uint8],
        rgb: NDArray[np.uint8],
    ) -> None:
        """Smooth the scene's edges in `rgb` (N, 3) by rays, as the other renderer does.

        OpenGL's own way, several samples a pixel, would blur the depth or need a second pass. The
        robot's outline stays as it was drawn.
        """
        width, height, focal = camera.width_px, camera.height_px, camera.focal_px
        flat = depth.ravel()
        surface = state.ravel().astype(np.int32)
        marked = find_edges(rgb, flat, surface, width, height, EDGE_BEND / focal, MIN_CONTRAST)
        beside = cv2.dilate((state == 3).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        order = pixel_order(width, height, self._packets.lanes)
        edges = order[(order >= 0) & (marked & ~beside.ravel())[order]]
        if not len(edges):
            return
        directions = subpixel_directions(edges, SUBPIXELS, rotation, focal, width, height)
        count = len(directions)
        samples = np.empty((count, 3), dtype=np.float32)
        ignored = np.empty(count, dtype=np.float32)
        names = np.empty((2, count), dtype=np.int32)
        render_rays(
            list_order(count, self._packets.lanes), directions,
            (0.5 * rotation[:, :2] / focal).T.astype(np.float32), position.astype(np.float32),
            cut_above_m, self._packets, self._arrays, light, spheres,
            samples, ignored, names[0], names[1],
        )  # fmt: skip
        smooth = np.empty((len(edges), 3), dtype=np.uint8)
        encode_srgb(add_samples(samples, len(SUBPIXELS), edges, color), self._encode, smooth)
        rgb[edges] = smooth

    def _lamp_gain(
        self,
        light: LightArrays,
        position: Array,
        directions: F32,
        depth: F32,
        state: NDArray[np.uint8],
    ) -> F32:
        """(H · W,) 0 in the lamp's shadow, else 1; (0,) when the lamp throws none."""
        if not (light.lamp_apart and light.lamp[6] > 0):
            return np.zeros(0, dtype=np.float32)
        gain = np.ones(depth.size, dtype=np.float32)
        lit = np.flatnonzero(state.ravel() == 2)
        reach = depth.ravel()[lit, None] - LAMP_LIFT_M
        points = (position + directions[lit] * reach).astype(np.float32)
        toward = (light.lamp[:3] - points).astype(np.float32)
        gain[lit[self._rays.hidden(points, toward)]] = 0.0
        return gain

    def _directions(self, camera: CameraModel, rotation: Array) -> F32:
        out = np.empty((camera.width_px * camera.height_px, 3), dtype=np.float32)
        fill_directions(rotation, camera.focal_px, camera.width_px, camera.height_px, out)
        return out


class _RobotDrawer:
    """One robot's body."""

    def __init__(self, context: GlContext, surfaces: tuple[GeomSurface, ...]):
        self.surfaces = surfaces
        self.shadow = ContactShadow(surfaces)
        self._drawer = ModelDrawer(context, robot_model(surfaces))
        model = self._drawer.model
        # MuJoCo moves meshes to their centres and turns them along their axes.
        self._moved, self._turned = model.geom_pos.copy(), quat_to_matrix(model.geom_quat)
        bounds = [(c.min(0), c.max(0)) for c in (s.corners.reshape(-1, 3) for s in surfaces)]
        signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        self._box = np.array([np.where(signs, high, low) for low, high in bounds])

    def draw(
        self, pose: RobotGeometryPose, camera: CameraModel, position: Array, rotation: Array
    ) -> tuple[NDArray[np.uint8], F32] | None:
        """Colours and depth of the posed body; None when it is out of view."""
        at, turn = pose.position_world_m, pose.rotation_world
        corners = np.einsum("gij,gkj->gki", turn, self._box) + at[:, None]
        seen, near, far = _in_view(corners, camera, position, rotation)
        inside = np.einsum("gji,gj->gi", turn, position - at)
        for k in np.flatnonzero(seen):  # a lens sits on the skin of its housing
            seen[k] = not self.surfaces[k].holds(inside[k], HOUSING_MARGIN_M)
        if not seen.any():
            return None
        model, data = self._drawer.model, self._drawer.data
        model.geom_group[:] = np.where(seen, 0, HIDDEN_GROUP)
        data.geom_xpos[:] = at + np.einsum("gij,gj->gi", turn, self._moved)
        data.geom_xmat[:] = (turn @ self._turned).reshape(-1, 9)
        return self._drawer.draw(camera, position, rotation, near, far, np.inf)


def _in_view(
    corners_m: Array, camera: CameraModel, position: Array, rotation: Array
) -> tuple[NDArray[np.bool_], float, float]:
    """Which boxes (G, 8, 3) a camera may see (G,), and how near and far those are [m]."""
    x, y, z = np.moveaxis((corners_m - position) @ rotation, -1, 0)
    right = 0.5 * camera.width_px / camera.focal_px
    down = 0.5 * camera.height_px / camera.focal_px
    seen = (z > 0).any(1)
    for side, slope in ((x, right), (-x, right), (y, down), (-y, down)):
        seen &= (side < slope * z).any(1)
    if not seen.any():
        return seen, NEAR_M, 1.0
    far = max(float(z[seen].max()) * 1.01, 2 * NEAR_M)
    return seen, float(np.clip(0.99 * z[seen].min(), NEAR_M, 0.5 * far)), far
