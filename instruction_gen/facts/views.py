"""What may be seen from the places where a walker decides."""

from collections.abc import Sequence

import numpy as np

from ...formats.core.geometry import onward
from ...wayfinding.regions import RegionMap
from .geometry import Array
from .records import LandmarkFact, PassageFact, SightFact, TurnFact, ViewFact

_DECIDES_M = 0.5
_FAR_M, _ASIDE_DEG = 6.0, 100.0
_SEEN_PIXELS = 12
_MIN_SIZE_M = 0.45
_AHEAD_M = 5.0


def views_of(
    landmarks: Sequence[LandmarkFact],
    turns: Sequence[TurnFact],
    passages: Sequence[PassageFact],
    length_m: float,
) -> tuple[ViewFact, ...]:
    """Return what may be seen at the start, before each turn and door, and at the goal."""
    points = [("start", 0.0), ("goal", length_m)]
    points += [("turn", turn.along_m) for turn in turns]
    points += [("door", passage.along_m) for passage in passages]
    result = []
    for point, along in sorted(points, key=lambda p: p[1]):
        from_m = along if point in ("start", "goal") else max(0.0, along - _DECIDES_M)
        things = [
            sight
            for mark in landmarks
            if mark.size_m >= _MIN_SIZE_M and (sight := _sight(mark, from_m, point == "start"))
        ]
        things.sort(key=lambda s: (s.distance_m, s.name))
        result.append(ViewFact(point, along, round(from_m, 2), tuple(things)))
    return tuple(result)


def _sight(mark: LandmarkFact, from_m: float, around: bool) -> SightFact | None:
    moment = min(mark.moments, key=lambda m: abs(m.along_m - from_m), default=None)
    if moment is None or abs(moment.along_m - from_m) > 0.2 or moment.distance_m > _FAR_M:
        return None
    if not (moment.open or moment.pixels >= _SEEN_PIXELS):
        return None
    if not around and abs(moment.facing_deg) > _ASIDE_DEG:
        return None
    return SightFact(mark.name, mark.noun, moment.distance_m, moment.facing_deg)


def room_ahead(regions: RegionMap, names: Sequence[str], path_xy_m: Array) -> str:
    """Return the next room on the straight line onward from the end of a path (P, 2) [m].

    "" if a wall comes first.
    """
    points = onward(path_xy_m, _AHEAD_M)
    own = int(regions.at(path_xy_m[-1]))
    cells = np.clip(regions.grid.cell_of(points), 0, np.array(regions.grid.shape) - 1)
    for region, width in zip(
        regions.at(points), regions.width_m[cells[:, 0], cells[:, 1]], strict=True
    ):
        if width <= 0:
            break
        if region >= 0 and region != own:
            return str(names[int(region)])
    return ""
