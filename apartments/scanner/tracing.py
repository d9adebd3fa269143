"""Trace rays through the exact apartment, in chunks that limit memory."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

_CHUNK = 1 << 18


@dataclass(frozen=True)
class Hits:
    """First hits of rays.

    Attributes:
        face: (N,) int32 triangle, −1 = nothing.
        distance_m: (N,) float32 along the (unit) direction; only meaningful where hit.
        bary: (N, 2) float32 weights of the triangle's second and third corner.
    """

    face: NDArray[np.int32]
    distance_m: NDArray[np.float32]
    bary: NDArray[np.float32]


class Tracer:
    """Ray tracer of a triangle soup (F, 3, 3) [m]."""

    def __init__(self, corners_m: NDArray[np.float64]):
        self._scene = EmbreeScene()
        # The scene keeps only a pointer: the arrays must live as long as it does.
        self._corners = np.ascontiguousarray(corners_m, dtype=np.float32)
        self._mesh = TriangleMesh(self._scene, self._corners)
        self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        # By one thread at a time: with two, scans on a busy machine have hung.
        self._lock = threading.Lock()

    def first(
        self, origins_m: NDArray[np.floating], directions: NDArray[np.floating], reach_m: float
    ) -> Hits:
        """Return the first hits of rays (N, 3), (N, 3) within `reach_m`."""
        count = len(origins_m)
        face = np.full(count, -1, dtype=np.int32)
        distance = np.zeros(count, dtype=np.float32)
        bary = np.zeros((count, 2), dtype=np.float32)
        for part, o, d in _chunks(origins_m, directions):
            with self._lock:
                found = self._scene.run(o, d, dists=np.full(len(o), reach_m, np.float32), output=1)
            face[part] = found["primID"]
            distance[part] = found["tfar"]
            bary[part, 0], bary[part, 1] = found["u"], found["v"]
        return Hits(face, distance, bary)

    def distance(
        self, origins_m: NDArray[np.floating], directions: NDArray[np.floating], reach_m: float
    ) -> NDArray[np.float32]:
        """Return the distance (N,) [m] to the first hit; `reach_m` where there is none."""
        result = np.empty(len(origins_m), dtype=np.float32)
        for part, o, d in _chunks(origins_m, directions):
            reach = np.full(len(o), reach_m, np.float32)
            with self._lock:
                found = self._scene.run(o, d, dists=reach, query="DISTANCE")
            result[part] = np.minimum(found, reach_m)
        return result

    def blocked(
        self,
        origins_m: NDArray[np.floating],
        directions: NDArray[np.floating],
        reach_m: NDArray[np.floating],
    ) -> NDArray[np.bool_]:
        """Return (N,) whether anything lies within `reach_m` (N,) along each ray."""
        result = np.empty(len(origins_m), dtype=bool)
        for part, o, d in _chunks(origins_m, directions):
            reach = np.ascontiguousarray(reach_m[part], dtype=np.float32)
            with self._lock:
                found = self._scene.run(o, d, dists=reach, query="OCCLUDED")
            result[part] = found != -1
        return result


def _chunks(
    origins_m: NDArray[np.floating], directions: NDArray[np.floating]
) -> Iterator[tuple[slice, NDArray[np.float32], NDArray[np.float32]]]:
    """Yield the rays in parts, as Embree takes them."""
    for first in range(0, len(origins_m), _CHUNK):
        part = slice(first, min(first + _CHUNK, len(origins_m)))
        o, d = (np.ascontiguousarray(v[part], np.float32) for v in (origins_m, directions))
        yield part, o, d
