"""Which point of the exact surface a point of the scan stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .tracing import Hits, Tracer

_BEFORE_M, _BEHIND_M = 0.05, 0.08


def exact_surface(
    tracer: Tracer, points_m: NDArray[np.float32], normals: NDArray[np.float32]
) -> Hits:
    """The exact surface near points (N, 3) with unit normals (N, 3).

    Looks along the normal from 5 cm before to 8 cm behind the point; where that misses, takes
    the nearest hit along the six axes. `Hits.distance_m` is not meaningful.
    """
    hits = tracer.first(points_m + np.float32(_BEFORE_M) * normals, -normals, _BEFORE_M + _BEHIND_M)
    missed = np.flatnonzero(hits.face < 0)
    if len(missed):
        best = np.full(len(missed), np.inf, dtype=np.float32)
        for axis in range(3):
            for sign in (-1.0, 1.0):
                direction = np.zeros((len(missed), 3), dtype=np.float32)
                direction[:, axis] = sign
                other = tracer.first(points_m[missed], direction, 0.3)
                nearer = (other.face >= 0) & (other.distance_m < best)
                best[nearer] = other.distance_m[nearer]
                hits.face[missed[nearer]] = other.face[nearer]
                hits.bary[missed[nearer]] = other.bary[nearer]
    return hits
