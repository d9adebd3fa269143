"""Which staircase of a repaired scene the path of a VLN-CE episode takes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from ...formats.core.geometry import distances_to_path
from ...formats.scene.bundle import SceneBundle
from ...formats.scene.freemap import Freemap
from ...wayfinding.storeys import Storeys
from .levels import level_gaps

_ON_FLOOR_M = 0.3  # a point no farther above or below a level's floor is on that level
_BESIDE_M = 1.2  # a point on a staircase is no farther from its middle line
_END_M = 1.0  # farthest that a start or goal floats


@dataclass(frozen=True)
class Climb:
    """How a path changes levels.

    Attributes:
        levels: of its start and its goal.
        before, behind: how many points at its start, and at its end, lie on them.
    """

    levels: tuple[int, int]
    staircase: int
    before: int
    behind: int


def climb_of(
    bundle: SceneBundle,
    freemaps: Sequence[Freemap],
    path_m: Array,
    *,
    radius_m: float,
    free_height_m: float,
) -> Climb | str:
    """Return how a path (P, 3) [m] takes one climbable staircase, or why it takes none.

    Args:
        freemaps: of the scene's levels.
        radius_m: of the robot that is to walk it [m].
    """
    gaps = np.abs(level_gaps(freemaps, path_m))
    first, last = (int(np.argmin(gaps[:, end])) for end in (0, -1))
    if max(gaps[first, 0], gaps[last, -1]) > _END_M:
        return "its start or its goal lies on no level's floor"
    if first == last:
        return f"it starts and ends on level {first}, so it takes no staircase between levels"
    ends = {first, last}
    candidates = [(k, s) for k, s in enumerate(bundle.staircases) if set(s.levels) == ends]
    if not candidates:
        return f"no staircase joins levels {first} and {last}"
    before = _leading(gaps[first] <= _ON_FLOOR_M)
    behind = _leading(gaps[last, ::-1] <= _ON_FLOOR_M)
    between = path_m[before : len(path_m) - behind]
    reasons = []
    for k, staircase in candidates:
        beside = distances_to_path(between, staircase.line_world_m) if len(between) else np.zeros(1)
        if staircase.problem:
            reasons.append(staircase.problem)
        elif beside.max() > _BESIDE_M:
            reasons.append(f"is {beside.max():.1f} m from its path")
        elif staircase.width_m < 2 * radius_m:
            reasons.append(f"is {staircase.width_m:.2f} m wide")
        elif not _reached(Storeys.of(bundle, [k], free_height_m), path_m, radius_m):
            reasons.append(f"is not reached by a robot of radius {radius_m:g} m")
        else:
            return Climb((first, last), k, before, behind)
    return "; ".join(
        f"staircase {k} {why}" for (k, _), why in zip(candidates, reasons, strict=True)
    )


def _leading(flags: np.ndarray) -> int:
    """Return how many of the flags (N,) are set before the first that is not."""
    return int(np.argmin(flags)) if not flags.all() else len(flags)


def _reached(storeys: Storeys, path_m: Array, radius_m: float) -> bool:
    """Return whether start and goal of a path (P, 3) [m] are joined for a robot."""
    return bool(np.isfinite(storeys.distance(path_m[-1], radius_m).at(path_m[0])))
