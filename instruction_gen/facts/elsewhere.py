"""Ways from a place to places all over a level, as a walker might take them."""

import numpy as np
from skimage.graph import MCP_Geometric

from ...formats.core.geometry import resample
from .geometry import Array
from .level import LevelFacts

_EVERY_CELLS = 3  # of the map
_BODY_M, _COMFORT_M, _GRAZING = 0.2, 0.35, 3.0  # how the sampler plans, on a coarser map
_GOALS_M, _INSIDE_M = 1.5, 1.2  # between places, and behind an opening
_SPACING_M, _ROUND_M = 0.25, 0.6


class Elsewhere:
    """Ways to places a metre and a half apart, and behind each opening.

    Attributes:
        places_m: (K, 2) where they lead [m].
        regions: (K,) of the level.
        costs_m: (K,) no less than their lengths [m].
    """

    def __init__(self, level: LevelFacts, start_m: Array):
        """Search from a place (2,) [m]."""
        self._start_m = start_m
        freemap, every = level.bundle.freemap(level.level), _EVERY_CELLS
        clear = np.where(freemap.traversable, freemap.clearance_m, 0.0)[::every, ::every]
        tight = 1.0 - np.clip((clear - _BODY_M) / _COMFORT_M, 0.0, 1.0)
        cells = np.argwhere(clear >= _BODY_M)
        xy_m = freemap.grid.center_of(cells * every)
        self._finder = MCP_Geometric(np.where(clear >= _BODY_M, 1.0 + _GRAZING * tight**2, -1.0))
        if not len(cells):
            self.places_m, self.regions, self.costs_m = xy_m, np.empty(0, dtype=int), np.empty(0)
            return
        own = level.regions.at(start_m)  # the nearest place outside may lie behind a wall
        gap_m = np.linalg.norm(xy_m - start_m, axis=1)
        start = cells[np.lexsort((gap_m, (level.regions.at(xy_m) != own) & (own >= 0)))[0]]
        costs = self._finder.find_costs([tuple(start)])[0][cells[:, 0], cells[:, 1]]
        region = np.where(np.isfinite(costs), level.regions.at(xy_m), -1)
        chosen = _chosen(xy_m, region, clear[cells[:, 0], cells[:, 1]], level)
        self._cells, self._center_of = cells[chosen], lambda c: freemap.grid.center_of(c * every)
        self.places_m, self.regions = xy_m[chosen], region[chosen]
        self.costs_m = costs[chosen] * every * freemap.grid.cell_m

    def way(self, number: int) -> Array:
        """Return the way (P, 2) [m] to a place, rounded at its corners."""
        line = self._center_of(np.array(self._finder.traceback(self._cells[number])))
        line = resample(np.vstack([self._start_m, line]), _SPACING_M)
        reach = int(_ROUND_M / _SPACING_M)
        padded = np.pad(line, ((reach, reach), (0, 0)), mode="edge")
        rounded = np.mean([padded[k : k + len(line)] for k in range(2 * reach + 1)], axis=0)
        return np.vstack([line[:1], rounded[1:-1], line[-1:]])


def _chosen(xy_m: Array, region: Array, clear_m: Array, level: LevelFacts) -> list[int]:
    """Return the widest place of each square of a region, and one inside each opening."""
    chosen: set[int] = set()
    squares = np.column_stack([np.floor(xy_m / _GOALS_M).astype(int), region])
    order = np.lexsort((-clear_m, *squares.T))
    first = np.r_[True, (np.diff(squares[order], axis=0) != 0).any(axis=1)]
    chosen.update(k for k in order[first].tolist() if region[k] >= 0)
    for opening in level.openings:
        off_m = np.abs(np.linalg.norm(xy_m - opening.middle_m, axis=1) - _INSIDE_M)
        for room in opening.rooms:
            here = np.flatnonzero(region == room)
            if len(here):
                chosen.add(int(here[off_m[here].argmin()]))
    return sorted(chosen)
