"""The robot's body in a frame: one small static Embree scene per geom, rays moved to its frame.

A geom never changes its shape, so that nothing is rebuilt when the robot moves; a frame costs only
the rays in the image rectangles of the geoms it can see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ...formats.camera import CameraModel
from .contact_shadow import ContactShadow
from .robot_body import GeomSurface, RobotGeometryPose
from .shading import Hits, shade_robot

F32 = NDArray[np.float32]

# Surface ids of robot geoms start here, downwards; scene materials are ≥ 0 and −1 is nothing.
FIRST_ROBOT_SURFACE = -2
# A lens sits on the skin of its housing: geoms that hold the camera up to this are not drawn.
HOUSING_MARGIN_M = 0.005


@dataclass(frozen=True)
class VisibleGeom:
    """A geom that may cover pixels of the current view.

    Attributes:
        index: of the geom among the robot's surfaces.
        rotation_world: (3, 3) geom to world.
        camera_in_geom_m: (3,) optical centre in the geom's frame [m].
        rectangle_px: left, top, right, bottom of what it can cover; right and bottom excluded.
    """

    index: int
    rotation_world: F32
    camera_in_geom_m: F32
    rectangle_px: tuple[int, int, int, int]


class RobotTracer:
    """The ray structures of one robot's geoms."""

    def __init__(self, surfaces: tuple[GeomSurface, ...]):
        """Build a scene per geom."""
        self.surfaces = surfaces
        self.shadow = ContactShadow(surfaces)
        self._scenes = []
        for surface in surfaces:
            scene = EmbreeScene()
            TriangleMesh(scene, surface.corners)
            self._scenes.append(scene)

    def visible(
        self,
        pose: RobotGeometryPose,
        position_world_m: NDArray[np.float64],
        rotation_world: NDArray[np.float64],
        camera: CameraModel,
    ) -> list[VisibleGeom]:
        """Geoms a camera can see, without those that hold it.

        Args:
            pose: the body.
            position_world_m: (3,) optical centre [m].
            rotation_world: (3, 3) optical frame to world.
            camera: intrinsics.
        """
        seen = []
        for index, surface in enumerate(self.surfaces):
            rotation = pose.rotation_world[index]
            offset = position_world_m - pose.position_world_m[index]
            center = (rotation @ surface.center_m - offset) @ rotation_world
            rectangle = _sphere_rectangle(center, surface.radius_m, camera)
            if rectangle is None:
                continue
            inside = offset @ rotation
            near = np.linalg.norm(inside - surface.center_m) < surface.radius_m + HOUSING_MARGIN_M
            if near and surface.holds(inside, HOUSING_MARGIN_M):
                continue
            seen.append(
                VisibleGeom(
                    index, rotation.astype(np.float32), inside.astype(np.float32), rectangle
                )
            )
        return seen

    def trace(
        self,
        geom: VisibleGeom,
        rays: NDArray[np.int64],
        directions: F32,
        light: F32,
        color: F32,
        depth: F32,
        surface: NDArray[np.int32],
    ) -> None:
        """Put a geom in front of what is farther.

        Args:
            geom: from `visible`.
            rays: (K,) indices of the rays that can meet it.
            directions: (N, 3) of all rays, world.
            light: `Light.parameters()`.
            color: (N, 3) colours so far, updated.
            depth: (N,) depths so far, updated.
            surface: (N,) surface ids so far, updated.
        """
        local = directions[rays] @ geom.rotation_world
        origins = np.empty_like(local)
        origins[:] = geom.camera_in_geom_m
        limits = np.minimum(depth[rays], np.float32(1e30))
        hit = self._scenes[geom.index].run(origins, local, dists=limits, output=True)
        found = np.flatnonzero(hit["primID"] >= 0)
        if not len(found):
            return
        rays = rays[found]
        shape = self.surfaces[geom.index]
        hits = Hits(*(hit[key][found] for key in ("primID", "u", "v", "tfar")))
        shade_robot(
            rays,
            directions,
            hits,
            shape.normals,
            geom.rotation_world,
            shape.color_linear,
            light,
            color,
        )
        depth[rays] = hits.depth
        surface[rays] = FIRST_ROBOT_SURFACE - geom.index


def _sphere_rectangle(
    center: NDArray[np.float64], radius: float, camera: CameraModel
) -> tuple[int, int, int, int] | None:
    """Pixels a sphere in the optical frame can cover; None when it is out of view."""
    width, height = camera.width_px, camera.height_px
    x, y, z = center
    if z <= -radius:
        return None
    if z <= 1.01 * radius:  # reaches behind the camera: may cover anything
        return 0, 0, width, height
    sides = []
    for across, size in ((x, width), (y, height)):
        # Tangents to a circle from the optical centre, in the plane of this axis and z.
        square = z * z - radius * radius
        root = radius * np.sqrt(max(across * across + square, 0.0))
        low = (across * z - root) / square * camera.focal_px + 0.5 * size
        high = (across * z + root) / square * camera.focal_px + 0.5 * size
        first, last = max(int(np.floor(low)), 0), min(int(np.ceil(high)), size)
        if first >= last:
            return None
        sides.append((first, last))
    (left, right), (top, bottom) = sides
    return left, top, right, bottom
