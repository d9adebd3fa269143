"""Even division of a polyline; `formats.planning.resample` keeps its corners instead."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def space_evenly(points_m: ArrayLike, step_m: float) -> NDArray[np.float64]:
    """Return points (M, D), M ≥ 1, about `step_m` apart along a polyline (N, D), ends included.

    The spacing is the largest one not above `step_m` that divides the length evenly.
    """
    points = np.asarray(points_m, dtype=np.float64)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if at[-1] == 0.0:
        return points[:1]
    wanted = np.linspace(0.0, at[-1], max(math.ceil(at[-1] / step_m - 1e-9), 1) + 1)
    return np.stack([np.interp(wanted, at, column) for column in points.T], axis=1)
