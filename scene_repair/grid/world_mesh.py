"""The scan in world coordinates while it is being repaired."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...formats.core.arrays import F32, I32, I64, Array, Mask
from ...formats.core.geometry import triangle_normals
from ..scan.record import Scan


@dataclass(frozen=True)
class WorldMesh:
    """Triangles in the world frame [m], else as in `Scan`; each repair step returns a new one."""

    vertices: Array
    faces: I64
    corner_uv: F32
    face_material: I32
    face_object: I32

    @staticmethod
    def of(scan: Scan, source_to_world: Array) -> "WorldMesh":
        """Transform a scan by a (4, 4) similarity."""
        vertices = scan.vertices @ source_to_world[:3, :3].T + source_to_world[:3, 3]
        return WorldMesh(vertices, scan.faces, scan.corner_uv, scan.face_material, scan.face_object)

    @cached_property
    def normals(self) -> Array:
        """Return unit normals (F, 3); zero for degenerate faces."""
        return triangle_normals(self.vertices[self.faces])

    def lowered(self, faces: Mask, drop_m: float) -> "WorldMesh":
        """Return the mesh with the marked faces (F,) hung lower, apart from their neighbours."""
        used, corners = np.unique(self.faces[faces], return_inverse=True)
        moved = self.faces.copy()
        moved[faces] = corners.reshape(-1, 3) + len(self.vertices)
        copies = self.vertices[used] - (0.0, 0.0, drop_m)
        return replace(self, vertices=np.concatenate([self.vertices, copies]), faces=moved)

    def extended(
        self, new_vertices: Array, new_faces: I64, new_uv: F32, *, material: int, obj: int
    ) -> "WorldMesh":
        """Append vertices and faces; `new_faces` index the joint vertex array."""
        count = len(new_faces)
        return WorldMesh(
            np.concatenate([self.vertices, new_vertices]),
            np.concatenate([self.faces, new_faces]),
            np.concatenate([self.corner_uv, new_uv.astype(np.float32)]),
            np.concatenate([self.face_material, np.full(count, material, dtype=np.int32)]),
            np.concatenate([self.face_object, np.full(count, obj, dtype=np.int32)]),
        )
