"""The default renderer: Embree traces, numba shades; no GPU, no display."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

from ...formats.camera import CameraModel
from ...formats.frames import quat_to_matrix
from ...formats.scene_bundle import SceneBundle
from .contact_shadow import darken_under
from .edges import add_samples, encode_srgb, find_edges
from .lights import get_light
from .rays import SUBPIXELS, fill_directions, subpixel_directions
from .robot_body import RobotGeometryPose
from .robot_trace import RobotTracer, VisibleGeom
from .scene_arrays import scene_arrays
from .shading import Hits, shade_scene
from .srgb import encode_table
from .textures import load_materials

F32 = NDArray[np.float32]

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
        self._light = get_light(light).parameters()
        mesh = bundle.visual()
        self._encode = encode_table()
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, mesh.vertices, mesh.faces)
        self._arrays = scene_arrays(mesh, load_materials(bundle), self._scene)
        self._directions = np.empty((0, 3), dtype=np.float32)
        self._robot = RobotTracer(())

    def render(
        self,
        camera: CameraModel,
        position_world_m: ArrayLike,
        quat_wxyz: ArrayLike,
        robot: RobotGeometryPose | None = None,
        cut_above_m: float = np.inf,
    ) -> tuple[NDArray[np.uint8], F32]:
        """One frame: RGB (H, W, 3) uint8 sRGB and depth (H, W) float32 planar z [m], 0 = none.

        See `interface.Renderer.render`.
        """
        position = np.asarray(position_world_m, dtype=np.float64)
        rotation = quat_to_matrix(quat_wxyz)
        width, height, focal = camera.width_px, camera.height_px, camera.focal_px
        if len(self._directions) != width * height:
            self._directions = np.empty((width * height, 3), dtype=np.float32)
        fill_directions(rotation, focal, width, height, self._directions)
        pixel = (rotation[:, :2] / focal).T.astype(np.float32)
        geoms: list[VisibleGeom] = []
        spheres = np.zeros((0, 4), dtype=np.float32)
        if robot is not None:
            if self._robot.surfaces is not robot.surfaces:
                self._robot = RobotTracer(robot.surfaces)
            geoms = self._robot.visible(robot, position, rotation, camera)
            if geoms:  # a robot out of view leaves no spot worth its time
                spheres = self._robot.shadow.posed(robot)
        color, depth, surface = self._trace(self._directions, position, pixel, spheres, cut_above_m)
        if geoms:
            centers = np.arange(width * height).reshape(height, width)
            for geom in geoms:
                left, top, right, bottom = geom.rectangle_px
                rays = centers[top:bottom, left:right].ravel()
                self._robot.trace(geom, rays, self._directions, self._light, color, depth, surface)
        depth[np.isinf(depth)] = 0.0

        rgb = np.empty((width * height, 3), dtype=np.uint8)
        encode_srgb(color, self._encode, rgb)
        edges = find_edges(rgb, depth, surface, width, height, EDGE_BEND / focal, MIN_CONTRAST)
        if len(edges):
            directions = subpixel_directions(edges, SUBPIXELS, rotation, focal, width, height)
            samples = self._trace(directions, position, 0.5 * pixel, spheres, cut_above_m)
            rows, columns = (np.repeat(i, len(SUBPIXELS)) for i in np.divmod(edges, width))
            for geom in geoms:
                left, top, right, bottom = geom.rectangle_px
                inside = (rows >= top) & (rows < bottom) & (columns >= left) & (columns < right)
                rays = np.flatnonzero(inside)
                self._robot.trace(geom, rays, directions, self._light, *samples)
            mixed = add_samples(samples[0], len(SUBPIXELS), edges, color)
            smooth = np.empty((len(edges), 3), dtype=np.uint8)
            encode_srgb(mixed, self._encode, smooth)
            rgb[edges] = smooth
        return rgb.reshape(height, width, 3), depth.reshape(height, width)

    def first_hit_m(self, origin_world_m: ArrayLike, direction_world: ArrayLike) -> float:
        """Distance [m] along a ray to the scene, the robot apart; inf when nothing is hit."""
        origin = np.asarray(origin_world_m, dtype=np.float32).reshape(1, 3)
        direction = np.asarray(direction_world, dtype=np.float64).reshape(1, 3)
        unit = (direction / np.linalg.norm(direction)).astype(np.float32)
        hit = self._scene.run(origin, unit, output=True)
        return float(hit["tfar"][0]) if hit["primID"][0] >= 0 else float("inf")

    def _trace(
        self,
        directions: F32,
        position: NDArray[np.float64],
        pixel: F32,
        spheres: F32,
        cut_above_m: float,
    ) -> tuple[F32, F32, NDArray[np.int32]]:
        """Linear colour (N, 3), depth (N,), inf = none, and surface (N,) of the scene's hits."""
        origins = np.empty_like(directions)
        origins[:] = position
        start = np.float32(0.0)
        if position[2] > cut_above_m:  # rays start where they pass the cut; if never, far away
            down = np.minimum(directions[:, 2], np.float32(-1e-6))
            start = np.float32(cut_above_m - position[2]) / down
            origins += start[:, None] * directions
        hit = self._scene.run(origins, directions, output=True)
        prim, depth = hit["primID"], hit["tfar"]
        depth += start
        depth[prim < 0] = np.inf
        color = np.empty_like(directions)
        hits = Hits(prim, hit["u"], hit["v"], depth)
        shade_scene(directions, pixel, hits, self._arrays, self._light, color)
        if len(spheres):
            eye = position.astype(np.float32)
            darken_under(spheres, eye, directions, hit["Ng"], depth, color)
        surface = np.where(prim >= 0, self._arrays.face_material[prim], -1)
        return color, depth, surface
