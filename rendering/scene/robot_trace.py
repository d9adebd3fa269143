"""Ray tracing of a robot's body: one small static Embree scene per geom, in the geom's frame.

Rays are transformed to the geoms, so that nothing is rebuilt when the robot moves; a frame costs
only the rays in the image rectangles of its visible geoms.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import F32, I64, Array
from ...formats.core.camera import CameraModel
from ...geometry.rays.packets import PacketHits, PacketScene
from ..frame import RenderRequest
from ..kernels.data import Hits, LightArrays
from ..kernels.shading import shade_robot
from ..light.contact_shadow import ContactShadow
from .robot_body import GeomSurface, bounding_boxes

# Surface ids of robot geoms start here, downwards; scene materials are ≥ 0 and −1 is nothing.
FIRST_ROBOT_SURFACE = -2
# A lens sits on the surface of its housing: geoms that contain the camera, up to this margin, are
# not drawn.
HOUSING_MARGIN_M = 0.005
NEAR_M = 0.001
# Corners as `bounding_boxes` numbers them; an edge joins two that differ in one bit.
BOX_EDGES = np.array([[i, i | bit] for bit in (1, 2, 4) for i in range(8) if not i & bit])


@dataclass(frozen=True)
class VisibleGeom:
    """A geom that may cover pixels of the current view.

    Attributes:
        index: index of the geom in the robot's surfaces.
        rotation_world: (3, 3) geom to world.
        camera_in_geom_m: (3,) optical centre in the geom's frame [m].
        rectangle_px: left, top, right, bottom of the pixels that it can cover, the latter two
            exclusive.
    """

    index: int
    rotation_world: F32
    camera_in_geom_m: F32
    rectangle_px: tuple[int, int, int, int]


class RobotTracer:
    """The ray structures of the geoms of one robot at a time."""

    def __init__(self) -> None:
        """Begin without a robot; the first frame with one builds a ray structure per geom."""
        self._load(())

    def _load(self, surfaces: tuple[GeomSurface, ...]) -> None:
        self._surfaces = surfaces
        self._shadow = ContactShadow(surfaces)
        self._box = bounding_boxes(surfaces)
        corners = [surface.corners.reshape(-1, 3) for surface in surfaces]
        self._scenes = [PacketScene(c, np.arange(len(c)).reshape(-1, 3)) for c in corners]

    def trace_pixels(
        self,
        geoms: list[VisibleGeom],
        directions: F32,
        request: RenderRequest,
        light: LightArrays,
        hits: Hits,
    ) -> None:
        """Add geoms to the hits of the pixels' centres (H · W,); see `trace`."""
        camera = request.camera
        pixels = np.arange(len(directions)).reshape(camera.height_px, camera.width_px)
        for geom in geoms:
            left, top, right, bottom = geom.rectangle_px
            rays = pixels[top:bottom, left:right].ravel()
            self.trace(geom, rays, directions, request.position, light, hits)

    def visible(self, request: RenderRequest) -> tuple[list[VisibleGeom], F32]:
        """Return the geoms that the camera can see, without those that contain it.

        With them come the spheres (S, 4) of the robot's shadow, none if it is out of view.
        """
        no_shadow = np.zeros((0, 4), dtype=np.float32)
        pose = request.robot
        if pose is None:
            return [], no_shadow
        if self._surfaces is not pose.surfaces:
            self._load(pose.surfaces)
        inside = np.einsum(
            "gji,gj->gi", pose.rotation_world, request.position - pose.position_world_m
        )
        into_view = np.einsum("gji,jk->gik", pose.rotation_world, request.rotation)
        view = (self._box - inside[:, None]) @ into_view
        seen: list[VisibleGeom] = []
        for index, rectangle in _rectangles(view, request.camera):
            surface = self._surfaces[index]
            distance = np.linalg.norm(inside[index] - surface.center_m)
            near = distance < surface.radius_m + HOUSING_MARGIN_M
            if near and surface.holds(inside[index], HOUSING_MARGIN_M):
                continue
            seen.append(
                VisibleGeom(
                    index,
                    pose.rotation_world[index].astype(np.float32),
                    inside[index].astype(np.float32),
                    rectangle,
                )
            )
        return seen, self._shadow.posed(pose) if seen else no_shadow

    def trace(
        self,
        geom: VisibleGeom,
        rays: I64,
        directions: F32,
        eye_m: Array,
        light: LightArrays,
        hits: Hits,
    ) -> None:
        """Add a geom to the hits of rays that it is nearer than.

        Args:
            geom: from `visible`.
            rays: (K,) indices of the rays that can hit it.
            directions: (N, 3) of all rays, world.
            eye_m: (3,) optical centre [m].
            hits: of all rays so far, updated.
        """
        local = directions[rays] @ geom.rotation_world
        origins = np.empty_like(local)
        origins[:] = geom.camera_in_geom_m
        far = np.minimum(hits.depth[rays], np.float32(1e30))
        touched = self._scenes[geom.index].trace(origins=origins, directions=local, far=far)
        nearer = np.flatnonzero(touched.prim >= 0)
        if not len(nearer):
            return
        rays = rays[nearer]
        surface = self._surfaces[geom.index]
        touched = PacketHits._make(values[nearer] for values in touched)
        shade_robot(
            rays, directions, eye_m.astype(np.float32), touched, surface.normals,
            geom.rotation_world, surface.color_linear, light, hits.color,
        )  # fmt: skip
        hits.depth[rays] = touched.depth
        hits.surface[rays] = FIRST_ROBOT_SURFACE - geom.index


def _rectangles(
    view: Array, camera: CameraModel
) -> Iterator[tuple[int, tuple[int, int, int, int]]]:
    """Yield the geoms in view and the pixels (left, top, right, bottom) their boxes can cover.

    `view` contains the boxes' corners (G, 8, 3) in the optical frame. Edges that pass the camera
    are cut at the near plane, so that parts beside or behind the camera cover nothing.
    """
    numbers = np.flatnonzero(view[..., 2].max(axis=1) >= NEAR_M)
    if not len(numbers):
        return
    view = view[numbers]  # of a robot with its camera in front, few: the rest is behind it
    start, stop = view[:, BOX_EDGES[:, 0]], view[:, BOX_EDGES[:, 1]]
    z0, z1 = start[..., 2:], stop[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((NEAR_M - z0) / (z1 - z0), 0.0, 1.0)
    cut = start + np.nan_to_num(share) * (stop - start)
    ends = np.concatenate(
        [np.where(z0 >= NEAR_M, start, cut), np.where(z1 >= NEAR_M, stop, cut)], 1
    )
    ahead = np.concatenate([np.maximum(z0, z1)] * 2, axis=1) >= NEAR_M
    center = 0.5 * np.array([camera.width_px, camera.height_px])
    pixels = ends[..., :2] / np.maximum(ends[..., 2:], NEAR_M) * camera.focal_px + center
    low = np.floor(np.where(ahead, pixels, np.inf).min(1))
    high = np.ceil(np.where(ahead, pixels, -np.inf).max(1))
    low = np.maximum(low, 0.0)
    high = np.minimum(high, 2 * center)
    for index in np.flatnonzero((low < high).all(-1)):
        left, top = (int(v) for v in low[index])
        right, bottom = (int(v) for v in high[index])
        yield int(numbers[index]), (left, top, right, bottom)
