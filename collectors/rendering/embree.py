"""The default renderer: Embree traces, numba shades; no GPU, no display."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...formats.core.camera import CameraModel
from ...formats.core.frames import quat_to_matrix
from ...formats.scene.bundle import SceneBundle
from .camera.rays import SUBPIXELS, fill_directions, list_order, subpixel_directions, tile_order
from .interface import NOTHING, ROBOT, Frame, Pose
from .kernels.data import LightArrays, Packets
from .kernels.edges import add_samples, encode_srgb, find_edges
from .kernels.eye_rays import render_rays
from .kernels.packets import TILES, PacketScene, lanes, packet
from .kernels.srgb import encode_table
from .light.lights import get_light
from .light.scene_light import light_arrays, with_lamp
from .scene.arrays import scene_arrays
from .scene.robot_body import RobotGeometryPose
from .scene.robot_trace import RobotTracer, VisibleGeom
from .scene.textures import load_materials

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]

MIN_CONTRAST = 18  # sRGB bytes; less is not seen as a stair
EDGE_BEND = 0.4  # creases sharper than about 25° count as edges


class SceneRenderer:
    """RGB and depth of one scene; see `interface.Renderer`.

    One ray per pixel gives depth and colour; pixels on visible edges get three rays more for their
    colour, while their depth stays that of the centre.
    """

    name = "embree"

    def __init__(self, bundle: SceneBundle, light: str = "baked"):
        """Load the mesh and textures and build the ray structure.

        Raises:
            UnknownNameError: no such light; the message lists the valid names.
            FileFormatError: the mesh or a texture cannot be read.
        """
        self.light = light
        kind = get_light(light)
        mesh = bundle.visual()
        self._encode = encode_table()
        self._scene = PacketScene(mesh.vertices, mesh.faces)
        self._arrays = scene_arrays(mesh, load_materials(bundle), kind.relit)
        any_shaded = bool(self._arrays.shaded.any())
        self._light = light_arrays(kind, bundle, mesh, self._scene, any_shaded)
        self._lamp = kind.lamp
        self._label, self._thing = mesh.face_label, mesh.face_object
        self._packets = Packets(
            self._scene.handle, self._scene.coherent, packet(), packet(), lanes()
        )
        self._directions = np.empty((0, 3), dtype=np.float32)
        self._robot = RobotTracer(())

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
        rgb, depth, _, _ = self._draw(
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
        """One frame with the labels and objects that its pixels show; see `interface.Renderer`."""
        rgb, depth, surface, prim = self._draw(
            camera, position_world_m, quat_wxyz, robot, cut_above_m, lamp_pose
        )
        label, thing = (
            np.where(prim < 0, NOTHING, names[prim]) for names in (self._label, self._thing)
        )
        label[surface < NOTHING] = thing[surface < NOTHING] = ROBOT
        return Frame(rgb, depth, label.reshape(depth.shape), thing.reshape(depth.shape))

    def _draw(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None,
        cut_above_m: float,
        lamp_pose: Pose | None,
    ) -> tuple[NDArray[np.uint8], F32, I32, I32]:
        """RGB (H, W, 3), depth (H, W), and per pixel (H · W,) surface and triangle."""
        position = np.asarray(position_world_m, dtype=np.float64)
        rotation = quat_to_matrix(quat_wxyz)
        width, height, focal = camera.width_px, camera.height_px, camera.focal_px
        count = width * height
        if len(self._directions) != count:
            self._directions = np.empty((count, 3), dtype=np.float32)
        fill_directions(rotation, focal, width, height, self._directions)
        pixel = (rotation[:, :2] / focal).T.astype(np.float32)
        light = with_lamp(self._light, self._lamp, position, quat_wxyz, lamp_pose)
        geoms: list[VisibleGeom] = []
        spheres = np.zeros((0, 4), dtype=np.float32)
        if robot is not None:
            if self._robot.surfaces is not robot.surfaces:
                self._robot = RobotTracer(robot.surfaces)
            geoms = self._robot.visible(robot, position, rotation, camera)
            if geoms:  # a robot out of view leaves no spot worth its time
                spheres = self._robot.shadow.posed(robot)
        eye = position.astype(np.float32)
        order = pixel_order(width, height, self._packets.lanes)
        color, depth, surface, prim = self._trace(
            order, self._directions, eye, pixel, spheres, cut_above_m, light
        )
        if geoms:
            centers = np.arange(count).reshape(height, width)
            for geom in geoms:
                left, top, right, bottom = geom.rectangle_px
                rays = centers[top:bottom, left:right].ravel()
                self._robot.trace(geom, rays, self._directions, eye, light, color, depth, surface)
        depth[np.isinf(depth)] = 0.0

        rgb = np.empty((count, 3), dtype=np.uint8)
        encode_srgb(color, self._encode, rgb)
        marked = find_edges(rgb, depth, surface, width, height, EDGE_BEND / focal, MIN_CONTRAST)
        edges = order[
            (order >= 0) & marked[order]
        ]  # tile by tile, for packets of rays close together
        if len(edges):
            directions = subpixel_directions(edges, SUBPIXELS, rotation, focal, width, height)
            order = list_order(len(directions), self._packets.lanes)
            mixed, far, material, _ = self._trace(
                order, directions, eye, 0.5 * pixel, spheres, cut_above_m, light
            )
            for geom in geoms:
                rays = _inside(geom, edges, width)
                self._robot.trace(geom, rays, directions, eye, light, mixed, far, material)
            mixed = add_samples(mixed, len(SUBPIXELS), edges, color)
            smooth = np.empty((len(edges), 3), dtype=np.uint8)
            encode_srgb(mixed, self._encode, smooth)
            rgb[edges] = smooth
        return rgb.reshape(height, width, 3), depth.reshape(height, width), surface, prim

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Distance [m] along a ray to the scene, the robot apart; inf when nothing is hit."""
        return first_hit_m(self._scene, origin_world_m, direction_world)

    def _trace(
        self,
        order: I32,
        directions: F32,
        eye: F32,
        pixel: F32,
        spheres: F32,
        cut_above_m: float,
        light: LightArrays,
    ) -> tuple[F32, F32, I32, I32]:
        """Linear colour (N, 3), depth (N,), inf = none, material and triangle (N,)."""
        count = len(directions)
        color = np.empty((count, 3), dtype=np.float32)
        depth = np.empty(count, dtype=np.float32)
        surface, prim = (np.empty(count, dtype=np.int32) for _ in range(2))
        render_rays(
            order, directions, pixel, eye, cut_above_m, self._packets, self._arrays, light, spheres,
            color, depth, surface, prim,
        )  # fmt: skip
        return color, depth, surface, prim


def first_hit_m(scene: PacketScene, origin_m: ArrayLike, direction: ArrayLike) -> float:
    """Distance [m] along a ray from (3,) towards (3,); inf when nothing is hit."""
    unit = np.asarray(direction, dtype=np.float64).reshape(1, 3)
    unit = (unit / np.linalg.norm(unit)).astype(np.float32)
    origin = np.asarray(origin_m, dtype=np.float32).reshape(1, 3)
    return float(scene.trace(origin, unit, np.full(1, np.inf, dtype=np.float32)).depth[0])


@functools.lru_cache(maxsize=8)
def pixel_order(width: int, height: int, lanes_: int) -> I32:
    """Pixels of an image tile by tile, for packets of that many rays; −1 = none."""
    return tile_order(width, height, TILES[lanes_])


def _inside(geom: VisibleGeom, pixels: I32, width: int) -> NDArray[np.int64]:
    """Samples of those `pixels` (K,) that a geom can cover, as indices into all samples."""
    left, top, right, bottom = geom.rectangle_px
    rows, columns = np.divmod(pixels, width)
    inside = (rows >= top) & (rows < bottom) & (columns >= left) & (columns < right)
    return np.flatnonzero(np.repeat(inside, len(SUBPIXELS)))
