"""Neighbourhood of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .surface import ScanMesh


def neighbours(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """(N, 2) pairs of triangles (F, 3) that share an edge."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    key = edges[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order[1:]] == key[order[:-1]]
    return np.stack([order[:-1][same], order[1:][same]], axis=1) // 3


def pieces(count: int, pairs: NDArray[np.int64]) -> NDArray[np.int32]:
    """(count,) number of the connected piece each of `count` items is in."""
    graph = coo_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count)
    )
    return connected_components(graph, directed=False)[1]


def smooth_normals(mesh: ScanMesh, rounds: int) -> NDArray[np.float64]:
    """(F, 3) unit face normals, averaged over `rounds` rings of neighbours by area."""
    normals, area = mesh.normals()
    for _ in range(rounds):
        at_vertex = np.zeros_like(mesh.vertices)
        for axis in range(3):
            weighted = np.repeat(normals[:, axis] * area, 3)
            at_vertex[:, axis] = np.bincount(
                mesh.faces.ravel(), weighted, minlength=len(mesh.vertices)
            )
        normals = at_vertex[mesh.faces].sum(1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals
