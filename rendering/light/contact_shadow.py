"""Soft contact shadow of a robot, without which it would seem to float.

Its parts are approximated by spheres. A sphere of radius r at distance d in direction u occludes
the share r² (n·u) / d² of the light on a surface with normal n (the form factor of a sphere); the
kernels in `surface_light` add them up.
"""

import numpy as np

from ...formats.core.arrays import F32, Array
from ..kernels.surface_light import SPHERE_REACH_M
from ..scene.robot_body import GeomSurface, RobotGeometryPose

MIN_RADIUS_M = 0.012  # the shadow of thinner parts is not worth its time
MAX_SPHERES_PER_GEOM = 3


class ContactShadow:
    """The spheres of one robot, computed once."""

    def __init__(self, surfaces: tuple[GeomSurface, ...]):
        """Fit spheres to each geom."""
        parts = [_spheres(surface) for surface in surfaces]
        counts = [len(centers) if r >= MIN_RADIUS_M else 0 for centers, r in parts]
        self._geom = np.repeat(np.arange(len(parts)), counts)
        self._local = np.concatenate(
            [np.zeros((0, 3)), *(c for c, r in parts if r >= MIN_RADIUS_M)]
        )
        self._radius = np.repeat([r for _, r in parts], counts)

    def posed(self, pose: RobotGeometryPose) -> F32:
        """Return the spheres (S, 4) of the posed body: world centre and radius [m]."""
        turned = np.einsum("sij,sj->si", pose.rotation_world[self._geom], self._local)
        center = turned + pose.position_world_m[self._geom]
        # Shapes overlap: a sphere whose centre lies in a larger one adds little.
        apart = np.linalg.norm(center[:, None] - center, axis=-1)
        larger = self._radius[:, None] < self._radius
        keep = ~(larger & (apart < self._radius)).any(1)
        return np.column_stack([center, self._radius])[keep].astype(np.float32)


def shadow_bounds(spheres: F32) -> F32:
    """Return the bounds (2, 3) [m] of what spheres (S, 4) darken, an empty box for none."""
    bounds = np.array([[np.inf] * 3, [-np.inf] * 3], dtype=np.float32)
    if len(spheres):
        reach = np.float32(SPHERE_REACH_M)
        bounds[:] = spheres[:, :3].min(0) - reach, spheres[:, :3].max(0) + reach
    return bounds


def _spheres(surface: GeomSurface) -> tuple[Array, float]:
    """Return centres (K, 3) in the geom's frame along its longest side, and their radius [m]."""
    corners = surface.corners.reshape(-1, 3).astype(np.float64)
    half = 0.5 * (corners.max(0) - corners.min(0))
    longest = int(np.argmax(half))
    across = np.delete(half, longest)
    radius = float(np.sqrt(across[0] * across[1]))
    count = int(np.clip(np.ceil(half[longest] / max(radius, 1e-6)), 1, MAX_SPHERES_PER_GEOM))
    centers = np.repeat(surface.center_m[None], count, axis=0)
    spread = max(half[longest] - radius, 0.0)
    centers[:, longest] += np.linspace(-spread, spread, count) if count > 1 else 0.0
    return centers, radius
