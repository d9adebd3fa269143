"""Read back the triangles of a written scene that must carry."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from ...formats.core.arrays import F32, Array, Mask
from ...formats.scene.bundle import SceneBundle

PATCH_MATERIAL = "floor_patch_"


@dataclass(frozen=True)
class Surface:
    """Triangles (T, 3, 3) [m], world, and (T,) whether the repair added them."""

    triangles_m: F32
    added: Mask

    def between(self, lower_m: Array, upper_m: Array) -> "Surface":
        """Return the triangles whose bounds overlap the box (3,), (3,)."""
        near = np.arange(len(self.triangles_m))
        # Most triangles are far above or below. Comparing corners is much faster than reducing.
        for axis in (2, 0, 1):
            a, b, c = (self.triangles_m[near, k, axis] for k in range(3))
            high = (a >= lower_m[axis]) | (b >= lower_m[axis]) | (c >= lower_m[axis])
            low = (a <= upper_m[axis]) | (b <= upper_m[axis]) | (c <= upper_m[axis])
            near = near[high & low]
        return Surface(self.triangles_m[near], self.added[near])


def visual_surface(bundle: SceneBundle) -> Surface:
    """Return the triangles of `visual.npz`."""
    visual = bundle.visual()
    patch = np.array([m.name.startswith(PATCH_MATERIAL) for m in bundle.materials] + [False])
    return Surface(visual.vertices[visual.faces], patch[visual.face_material])


def usd_surfaces(path: Path) -> tuple[Surface, Surface]:
    """Return the visible and the colliding triangles of a USD scene."""
    parts: dict[bool, list[F32]] = {False: [], True: []}
    added: list[Mask] = []
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        if not prim.IsA(UsdGeom.Mesh):
            continue
        collides = prim.HasAPI(UsdPhysics.CollisionAPI)
        triangles = _triangles(UsdGeom.Mesh(prim))
        parts[collides].append(triangles)
        if not collides:
            patch = prim.GetName().startswith(PATCH_MATERIAL)
            added.append(np.full(len(triangles), patch))
    empty = np.empty((0, 3, 3), dtype=np.float32)
    seen, solid = (np.concatenate([empty, *parts[key]]) for key in (False, True))
    none = np.empty(0, dtype=bool)
    return Surface(seen, np.concatenate([none, *added])), Surface(solid, np.zeros(len(solid), bool))


def _triangles(mesh: UsdGeom.Mesh) -> F32:
    points = np.asarray(mesh.GetPointsAttr().Get(), dtype=np.float32)
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get())
    index = np.asarray(mesh.GetFaceVertexIndicesAttr().Get())
    first = np.cumsum(counts) - counts
    # Polygons become fans around their first corner.
    fans = np.maximum(counts - 2, 0)
    face = np.repeat(np.arange(len(counts)), fans)
    step = np.arange(len(face)) - np.repeat(np.cumsum(fans) - fans, fans)
    start = first[face]
    return points[
        np.stack([index[start], index[start + step + 1], index[start + step + 2]], axis=1)
    ]
