"""Find the point of the exact surface, and the object, for each point of the scan."""

import numpy as np
from scipy.spatial import KDTree

from ...formats.core.arrays import F32, I32, I64
from ...geometry.fusion.surface import ScanMesh, neighbours, smooth_normals
from ...geometry.rays.packets import PacketHits
from .tracing import Tracer

_BEFORE_M, _BEHIND_M = 0.05, 0.08


def exact_surface(tracer: Tracer, points_m: F32, normals: F32) -> PacketHits:
    """Find the exact surface near points (N, 3) with unit normals (N, 3).

    Looks along the normal from 5 cm before to 8 cm behind the point; where that misses, takes
    the nearest hit along the six axes. `depth` and `normal` of the hits are not meaningful.
    """
    hits = tracer.first(points_m + np.float32(_BEFORE_M) * normals, -normals, _BEFORE_M + _BEHIND_M)
    missed = np.flatnonzero(hits.prim < 0)
    if len(missed):
        best = np.full(len(missed), np.inf, dtype=np.float32)
        for axis in range(3):
            for sign in (-1.0, 1.0):
                direction = np.zeros((len(missed), 3), dtype=np.float32)
                direction[:, axis] = sign
                other = tracer.first(points_m[missed], direction, 0.3)
                nearer = (other.prim >= 0) & (other.depth < best)
                best[nearer] = other.depth[nearer]
                hits.prim[missed[nearer]] = other.prim[nearer]
                hits.u[missed[nearer]], hits.v[missed[nearer]] = other.u[nearer], other.v[nearer]
    return hits


def label_faces(mesh: ScanMesh, tracer: Tracer, face_object: I32) -> I32:
    """Return the object index (F,) of each triangle; specks take their neighbours' label."""
    centers = mesh.vertices[mesh.faces].mean(1).astype(np.float32)
    normals = smooth_normals(mesh, 1).astype(np.float32)
    hits = exact_surface(tracer, centers, normals)
    label = np.where(hits.prim >= 0, face_object[hits.prim], -1).astype(np.int32)
    pairs = neighbours(mesh.faces)
    for _ in range(3):
        label = _majority(label, pairs)
    lost = np.flatnonzero(label < 0)
    if len(lost):
        # Nothing exact is near (a noisy speck): it belongs to the nearest labelled triangle.
        labelled = np.flatnonzero(label >= 0)
        label[lost] = label[labelled[KDTree(centers[labelled]).query(centers[lost])[1]]]
    return label


def _majority(label: I32, pairs: I64) -> I32:
    """Relabel each triangle whose neighbours all agree on another label."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    me, other = both[order, 0], label[both[order, 1]]
    low = np.full(len(label), np.iinfo(np.int32).max, dtype=np.int32)
    high = np.full(len(label), -1, dtype=np.int32)
    np.minimum.at(low, me, other)
    np.maximum.at(high, me, other)
    return np.where((low == high) & (high >= 0), high, label)
