"""How alike two paths are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..formats.core.geometry import arc_length, point_along

_STATIONS = 32


def stations(path_m: ArrayLike) -> NDArray[np.float64]:
    """A path (P, 2 or 3) [m] as `_STATIONS` points (S, 2) at equal fractions of its length."""
    path = np.asarray(path_m, dtype=np.float64)[:, :2]
    return point_along(path, np.linspace(0.0, arc_length(path)[-1], _STATIONS))


def path_gap(path_m: ArrayLike, others_m: Sequence[ArrayLike]) -> float:
    """Least mean distance [m] of a path to any of `others_m`; inf when there are none.

    Points at equal fractions of the length are compared, so that direction counts: the way back
    is another path.
    """
    if not len(others_m):
        return float("inf")
    mine = stations(path_m)
    theirs = np.stack([stations(o) for o in others_m])
    return float(np.linalg.norm(theirs - mine, axis=2).mean(axis=1).min())
