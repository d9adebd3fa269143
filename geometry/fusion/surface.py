"""The triangle mesh of a fused volume, and the neighbourhood of its triangles.

Only cells that were seen entirely become surface.
"""

from dataclasses import dataclass
from typing import Any

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

from ...formats.core.arrays import F32, I32, I64, Array, Floats
from ...formats.core.geometry import distinct_rows, triangle_normals_and_areas
from .volume import DistanceVolume

_LEAST_WEIGHT = 0.06
# A true surface changes the field by at most √3 / 3 across a cell; more is two views that
# contradict each other (the far side of something thin), not a surface.
_STEEPEST = 1.25
_SMALLEST_PATCH = 60


@dataclass(frozen=True)
class ScanMesh:
    """A triangle mesh.

    Attributes:
        vertices: (V, 3) float64 world [m].
        faces: (F, 3) int32, counter-clockwise seen from where the scanner was.
    """

    vertices: Array
    faces: I32

    @staticmethod
    def of_corners(corners_m: Array) -> "ScanMesh":
        """Return the mesh of loose triangles (F, 3, 3) [m]."""
        faces = np.arange(3 * len(corners_m), dtype=np.int32).reshape(-1, 3)
        return ScanMesh(corners_m.reshape(-1, 3), faces)

    def normals(self) -> tuple[Array, Array]:
        """Return unit normals (F, 3) and areas (F,) [m²]."""
        return triangle_normals_and_areas(self.vertices[self.faces])


def extract(
    volume: DistanceVolume, target_faces: int, least_weight: float = _LEAST_WEIGHT
) -> ScanMesh:
    """Run marching cubes over fully seen cells; remove specks; decimate to `target_faces`."""
    mesh = _march(volume, least_weight)
    mesh = without_specks(mesh, _SMALLEST_PATCH)
    reduction = float(1.0 - target_faces / max(len(mesh.faces), 1))
    if reduction > 0:
        points, faces = fast_simplification.simplify(mesh.vertices, mesh.faces, reduction)[:2]
        mesh = ScanMesh(np.asarray(points, dtype=np.float64), np.asarray(faces, dtype=np.int32))
    return without_specks(_tidy(mesh), 12)


def _march(volume: DistanceVolume, least_weight: float) -> ScanMesh:
    seen = volume.weight > least_weight
    high = np.where(seen, volume.value, np.float32(9))
    low = np.where(seen, volume.value, np.float32(-9))
    for axis in range(3):
        high = np.maximum(*_neighbours_along(high, axis))
        low = np.minimum(*_neighbours_along(low, axis))
    mask = np.zeros(volume.value.shape, dtype=bool)
    # scikit-image looks at the mask of a cell's last corner.
    mask[1:, 1:, 1:] = (high - low < _STEEPEST) & (high > 0) & (low < 0)
    points, faces, *_ = marching_cubes(
        volume.value, 0.0, mask=mask, gradient_direction="descent", allow_degenerate=False
    )
    vertices = points.astype(np.float64) * volume.voxel_m + volume.origin_m
    return ScanMesh(vertices, faces.astype(np.int32))


def _neighbours_along(field: F32, axis: int) -> tuple[F32, F32]:
    """Return all but the last and all but the first of a field's values along an axis."""
    along = np.moveaxis(field, axis, 0)
    return np.moveaxis(along[:-1], 0, axis), np.moveaxis(along[1:], 0, axis)


def _tidy(mesh: ScanMesh) -> ScanMesh:
    """Remove degenerate and duplicate triangles."""
    faces = mesh.faces
    _, area = mesh.normals()
    ordered = np.sort(faces, axis=1)
    keep = np.zeros(len(faces), dtype=bool)
    keep[distinct_rows(ordered)[0]] = True
    keep &= (area > 1e-9) & (ordered[:, 0] != ordered[:, 1]) & (ordered[:, 1] != ordered[:, 2])
    return _compact(mesh.vertices, faces[keep])


def without_specks(mesh: ScanMesh, least_faces: int) -> ScanMesh:
    """Remove connected pieces of fewer than `least_faces` triangles."""
    faces = mesh.faces
    piece = pieces(len(mesh.vertices), np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]]))
    size = np.bincount(piece[faces[:, 0]], minlength=piece.max(initial=0) + 1)
    return _compact(mesh.vertices, faces[size[piece[faces[:, 0]]] >= least_faces])


def _compact(vertices: Array, faces: I32) -> ScanMesh:
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return ScanMesh(vertices[used], number[faces])


def neighbours(faces: I32) -> I64:
    """Return pairs (N, 2) of triangles (F, 3) that share an edge."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    key = edges[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    return np.stack([order[:-1][same], order[1:][same]], axis=1) // 3


def pieces(count: int, pairs: NDArray[np.integer[Any]]) -> I32:
    """Return the connected component (count,) of each of `count` items."""
    edges = np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])
    return connected_components(coo_matrix(edges, shape=(count, count)), directed=False)[1]


def smooth_normals(mesh: ScanMesh, rounds: int) -> Array:
    """Return unit face normals (F, 3), area-averaged over `rounds` rings of neighbours."""
    normals, area = mesh.normals()
    for _ in range(rounds):
        weighted = np.repeat(normals * area[:, None], 3, axis=0)
        at_vertex = sums(mesh.faces.ravel(), weighted, len(mesh.vertices))
        normals = unit(at_vertex[mesh.faces].sum(1))
    return normals


def sums(index: I32 | I64, values: Floats, count: int) -> Array:
    """Return the sums (count, 3) of the values (N, 3) that have each index (N,)."""
    columns = [np.bincount(index, values[:, k], count) for k in range(3)]
    return np.stack(columns, axis=1, dtype=np.float64)


def unit(vectors: Array) -> Array:
    """Return vectors (N, 3) in unit length; (almost) zero stays so."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
