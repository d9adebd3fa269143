"""Write meshes of the USD scene: visual ones, and colliders of floor and obstacles."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt

from ...formats.core.arrays import F32, I32, I64, Array
from ...formats.core.geometry import distinct_rows
from ...formats.scene.bundle import Floor, Obstacles
from ..grid.morphology import grow

# Cells of a floor that differ by more do not slope into each other.
STEP_M = 0.02
# A box's corners are numbered by bits x, y, z; quads run counter-clockwise seen from outside.
_BOX_QUADS = np.array(
    [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]]
)


def visual_mesh(
    stage: Usd.Stage,
    path: str,
    corners: F32,
    index: I32,
    corner_uv: F32,
    material: UsdShade.Material,
) -> None:
    """Write a textured mesh: points (V, 3) [m], triangles (F, 3), v-up coordinates (F, 3, 2)."""
    mesh = _mesh(stage, path, corners, index)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
    )
    uv = np.ascontiguousarray(corner_uv.reshape(-1, 2), dtype=np.float32)
    primvar.Set(Vt.Vec2fArray.FromNumpy(uv))
    mesh.CreateDoubleSidedAttr(True)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def collider(
    stage: Usd.Stage, path: str, points: Array, faces: I64, material: UsdShade.Material
) -> Usd.Prim:
    """Write a static collider: a mesh that is not rendered and that no rigid body moves."""
    mesh = _mesh(stage, path, points.astype(np.float32), faces)
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    prim = mesh.GetPrim()
    UsdPhysics.CollisionAPI.Apply(prim)
    # Static colliders are taken as the triangles they are, not as a convex hull.
    UsdPhysics.MeshCollisionAPI.Apply(prim).CreateApproximationAttr(UsdPhysics.Tokens.none)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(
        material, UsdShade.Tokens.weakerThanDescendants, "physics"
    )
    return prim


def _mesh(stage: Usd.Stage, path: str, points: F32, faces: I32 | I64) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = np.ascontiguousarray(points, dtype=np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    counts = np.full(len(faces), faces.shape[1], dtype=np.int32)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    flat = np.ascontiguousarray(faces.reshape(-1), dtype=np.int32)
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(flat))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    extent = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float32)
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(extent))
    return mesh


def floor_surface(floor: Floor) -> tuple[Array, I64]:
    """Return the floor as quads facing up; corner heights average the cells around them.

    Cells that lie a step higher or lower do not count, so that edges stay sharp. It reaches one
    cell beyond the covered ones: under walls, so nothing slips in between.
    """
    width = floor.grid.columns + 1
    height = np.pad(floor.height_m.astype(np.float64), 1, mode="edge")
    i, j = np.nonzero(grow(floor.covered))
    own = height[i + 1, j + 1]
    nodes, levels = [], []
    # Corners counter-clockwise; around node (a, b) lie the padded cells a, a + 1 by b, b + 1.
    for a, b in ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)):
        around = np.stack([height[a, b], height[a, b + 1], height[a + 1, b], height[a + 1, b + 1]])
        same = np.abs(around - own) <= STEP_M
        nodes.append(a * width + b)
        levels.append((around * same).sum(axis=0) / same.sum(axis=0))
    node, z = np.stack(nodes, axis=1).ravel(), np.stack(levels, axis=1).ravel()
    key = np.stack([node, np.rint(z * 1e5).astype(np.int64)], axis=1)
    first, kind = distinct_rows(key)
    xy = floor.grid.center_of(np.stack([node[first] // width, node[first] % width], axis=1) - 0.5)
    points = np.column_stack([xy, z[first]]).astype(np.float64)
    return points, kind.reshape(-1, 4)


def box_surfaces(obstacles: Obstacles) -> tuple[Array, I64]:
    """Return boxes as quads facing outwards: (8 N, 3) points [m] and (6 N, 4) indices."""
    bits = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)]) * 2 - 1
    points = obstacles.center_m[:, None] + obstacles.half_m[:, None] * bits[None]
    faces = _BOX_QUADS[None] + 8 * np.arange(len(points))[:, None, None]
    return points.reshape(-1, 3), faces.reshape(-1, 4)
