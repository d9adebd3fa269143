"""The soft dark spot under a robot, without which it would seem to float.

Its parts are taken as spheres; a sphere of radius r at distance d in direction u hides the share
r² (n·u) / d² of the light on a surface with normal n (the form factor of a sphere).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .robot_body import GeomSurface, RobotGeometryPose

F32 = NDArray[np.float32]
f32 = np.float32

REACH_M = 0.8  # no shadow farther than this from every part
STRENGTH = 3.0
MIN_RADIUS_M = 0.012  # thinner parts leave no spot worth its time
MAX_SPHERES_PER_GEOM = 3
FAST = {"contract", "arcp", "nsz", "reassoc"}


class ContactShadow:
    """The spheres of one robot, prepared once."""

    def __init__(self, surfaces: tuple[GeomSurface, ...]):
        """Choose spheres for each geom."""
        parts = [_spheres(surface) for surface in surfaces]
        counts = [len(centers) if r >= MIN_RADIUS_M else 0 for centers, r in parts]
        self._geom = np.repeat(np.arange(len(parts)), counts)
        self._local = np.concatenate(
            [np.zeros((0, 3)), *(c for c, r in parts if r >= MIN_RADIUS_M)]
        )
        self._radius = np.repeat([r for _, r in parts], counts)

    def posed(self, pose: RobotGeometryPose) -> F32:
        """Spheres (S, 4) of the posed body: world centre and radius [m]."""
        turned = np.einsum("sij,sj->si", pose.rotation_world[self._geom], self._local)
        center = turned + pose.position_world_m[self._geom]
        # Shells overlap: a sphere whose centre lies in a larger one adds nothing but time.
        apart = np.linalg.norm(center[:, None] - center, axis=-1)
        larger = self._radius[:, None] < self._radius
        keep = ~(larger & (apart < self._radius)).any(1)
        return np.column_stack([center, self._radius])[keep].astype(np.float32)


def _spheres(surface: GeomSurface) -> tuple[NDArray[np.float64], float]:
    """Centres (K, 3) in the geom's frame along its longest side, and their radius."""
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


@njit(cache=True, error_model="numpy", fastmath=FAST)
def darken_under(
    spheres: F32,
    position: F32,
    directions: F32,
    normals: F32,
    depth: F32,
    color: F32,
):
    """Darken what lies near the spheres.

    Args:
        spheres: (S, 4) world centre and radius [m].
        position: (3,) of the camera [m].
        directions: (N, 3) rays.
        normals: (N, 3) geometric normals of the hits, any length and side.
        depth: (N,) ray parameters of the hits.
        color: (N, 3) linear light, updated.
    """
    low = np.full(3, np.inf, dtype=np.float32)
    high = np.full(3, -np.inf, dtype=np.float32)
    for s in range(spheres.shape[0]):
        for k in range(3):
            low[k] = min(low[k], spheres[s, k] - f32(REACH_M))
            high[k] = max(high[k], spheres[s, k] + f32(REACH_M))
    for i in range(depth.shape[0]):
        t = depth[i]
        if not t < f32(1e6):
            continue
        x = position[0] + t * directions[i, 0]
        y = position[1] + t * directions[i, 1]
        z = position[2] + t * directions[i, 2]
        if x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
            continue
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        along = nx * directions[i, 0] + ny * directions[i, 1] + nz * directions[i, 2]
        scale = f32(1.0) / np.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-20)))
        if along > f32(0.0):
            scale = -scale
        hidden = f32(0.0)
        for s in range(spheres.shape[0]):
            ux, uy, uz = spheres[s, 0] - x, spheres[s, 1] - y, spheres[s, 2] - z
            square = ux * ux + uy * uy + uz * uz
            if square < f32(REACH_M * REACH_M):
                height = (nx * ux + ny * uy + nz * uz) * scale
                if height > f32(0.0):
                    radius = spheres[s, 3]
                    square = max(square, radius * radius)
                    fade = f32(1.0) - square * f32(1.0 / (REACH_M * REACH_M))
                    hidden += fade * radius * radius * height / (square * np.sqrt(square))
        factor = np.exp(-f32(STRENGTH) * hidden)
        color[i, 0] *= factor
        color[i, 1] *= factor
        color[i, 2] *= factor
