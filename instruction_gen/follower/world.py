"""What the follower knows: free space, rooms, doorways and labelled objects of a level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from ...formats.scene.bundle import SceneBundle
from ...wayfinding.regions import ROOM_PREFIX, RegionMap, region_map
from ..facts.doors import DOOR, doorways
from ..language.lexicon import ROOM_PHRASES
from ..language.nouns import answers, noun_of, room_of

Array = NDArray[np.float64]

CELL_M = 0.15
RADIUS_M = 0.22


@dataclass(frozen=True)
class Thing:
    """An object or a doorway: its noun and its box [m]."""

    noun: str
    low_m: Array
    high_m: Array


class Field:
    """Ways from one place to all others."""

    def __init__(self, cost: Array, start: tuple[int, int]):
        """Spread from a cell."""
        self._finder = MCP_Geometric(cost)
        reached, _ = self._finder.find_costs([start])
        self.distance_m: Array = np.where(np.isfinite(reached), reached * CELL_M, np.inf)

    def way(self, cell: tuple[int, int]) -> NDArray[np.int64]:
        """Cells (K, 2) from the start to a cell."""
        return np.array(self._finder.traceback(cell))


class World:
    """A level on a coarse grid.

    Attributes:
        things: objects with a noun, and doorways.
        rooms: canonical name of each region.
        region: (R, C) region of each cell, −1 = none.
        centers_m: (R, C, 2) centres of the cells [m].
    """

    def __init__(self, bundle: SceneBundle, level: int, regions: RegionMap | None = None):
        """Read a level of a scene."""
        regions = regions or region_map(bundle, level)
        freemap = bundle.freemap(level)
        low = np.asarray(freemap.grid.origin_xy_m)
        size = np.array([freemap.grid.columns, freemap.grid.rows]) * freemap.grid.cell_m
        columns, rows = (int(n) for n in np.ceil(size / CELL_M))
        xs = low[0] + (np.arange(columns) + 0.5) * CELL_M
        ys = low[1] + (np.arange(rows) + 0.5) * CELL_M
        self.centers_m: Array = np.stack(np.meshgrid(xs, ys), axis=-1)
        cells = np.clip(freemap.grid.cell_of(self.centers_m), 0, np.array(freemap.grid.shape) - 1)
        free = freemap.free(RADIUS_M)[cells[..., 0], cells[..., 1]]
        clear = freemap.clearance_m[cells[..., 0], cells[..., 1]]
        self.free = free
        # Walking close to things is dearer, as people keep away from them.
        self._cost = np.where(free, 1.0 + np.clip(0.6 - clear, 0.0, 0.4), -1.0)
        self.region = regions.at(self.centers_m)
        self.rooms = tuple(room_of(name) for name in regions.names)
        floor = bundle.level_floor_z_m[level]
        self.things = [
            Thing(noun_of(o.category), np.array(o.lower_m[:2]), np.array(o.upper_m[:2]))
            for o in bundle.objects
            if o.level in (level, -1)
            and not o.category.startswith(ROOM_PREFIX)
            and noun_of(o.category) not in ("", "door")
        ]
        self.things += [
            Thing(DOOR, np.array(d.lower_m[:2]), np.array(d.upper_m[:2]))
            for d in doorways(regions, level, floor)
        ]
        self._fields: dict[tuple[int, int], Field] = {}

    def cell(self, xy_m: Array) -> tuple[int, int]:
        """The free cell nearest to a point (2,) [m]."""
        gap = np.linalg.norm(self.centers_m - xy_m, axis=-1)
        gap[~self.free] = np.inf
        row, column = np.unravel_index(int(np.argmin(gap)), gap.shape)
        return int(row), int(column)

    def field(self, cell: tuple[int, int]) -> Field:
        """Ways from a cell, kept."""
        if cell not in self._fields:
            self._fields[cell] = Field(self._cost, cell)
        return self._fields[cell]

    def called(self, head: str) -> list[Thing]:
        """Things that may be called so."""
        if head in ("door", DOOR):
            return [t for t in self.things if t.noun == DOOR]
        return [t for t in self.things if t.noun != DOOR and head in answers(t.noun)]

    def gap_m(self, thing: Thing) -> Array:
        """(R, C) distance of each cell to a thing's edge [m]."""
        edge = np.clip(self.centers_m, thing.low_m, thing.high_m)
        return np.linalg.norm(self.centers_m - edge, axis=-1)

    def regions_called(self, head: str) -> list[int]:
        """Regions that may be called so."""
        rooms = ROOM_PHRASES.get(head, frozenset())
        return [k for k, name in enumerate(self.rooms) if name in rooms]
