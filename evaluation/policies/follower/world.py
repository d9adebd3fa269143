"""The map of the follower: free space, rooms, doorways and labelled objects of a level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....formats.core.frames import Array
from ....formats.scene.bundle import LabeledObject
from ....formats.scene.freemap import Freemap
from ....instruction_gen.facts.doors import DOOR, OPENING, as_thing, find_openings
from ....instruction_gen.facts.geometry import no_wall_between, skin_of
from ....instruction_gen.facts.rooms import room_names
from ....instruction_gen.language.lexicon import ROOM_PHRASES
from ....instruction_gen.language.nouns import called, noun_of
from ....wayfinding.regions import ROOM_PREFIX, RegionMap

CELL_M = 0.15
RADIUS_M = 0.22
SIGHT_M = 7.0


@dataclass(frozen=True)
class Thing:
    """An object or a doorway: its noun, its box [m] and the region that its middle lies in."""

    noun: str
    low_m: Array
    high_m: Array
    region: int = -1

    @property
    def middle_m(self) -> Array:
        """(2,) [m]."""
        return 0.5 * (self.low_m + self.high_m)


class World:
    """A level on a coarse grid.

    Attributes:
        things: objects with a noun, and doorways.
        rooms: canonical name of each region.
        region: (R, C) region of each cell, −1 = none.
        centers_m: (R, C, 2) centres of the cells [m].
    """

    def __init__(self, freemap: Freemap, regions: RegionMap, objects: Sequence[LabeledObject]):
        """Read the map of one level, with its floor at z = 0."""
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
        self.cost = np.where(free, 1.0 + np.clip(0.6 - clear, 0.0, 0.4), -1.0)
        self.region = regions.at(self.centers_m)
        self.rooms = room_names(regions, objects)
        self.things = [
            _thing(noun_of(o.category), o, regions)
            for o in objects
            if not o.category.startswith(ROOM_PREFIX) and noun_of(o.category) not in ("", "door")
        ]
        self.things += [
            _thing(opening.noun, as_thing(opening, n, 0, 0.0), regions)
            for n, opening in enumerate(find_openings(regions, objects))
        ]
        self._regions = regions
        self._gaps: dict[int, Array] = {}

    def cell(self, xy_m: Array) -> tuple[int, int]:
        """Return the free cell nearest to a point (2,) [m]."""
        gap = np.linalg.norm(self.centers_m - xy_m, axis=-1)
        gap[~self.free] = np.inf
        row, column = np.unravel_index(int(np.argmin(gap)), gap.shape)
        return int(row), int(column)

    def beside(self, home: int, other: int) -> NDArray[np.bool_]:
        """Return the cells of region `other` that touch region `home`."""
        inside = self.region == home
        near = np.zeros_like(inside)
        for axis in (0, 1):
            for shift in (1, -1):
                near |= np.roll(inside, shift, axis)
        return near & (self.region == other) & self.free

    def called(self, head: str) -> list[int]:
        """Return indices of things that may be called so; `kitchen table`: a table in a kitchen."""
        if head in ("door", DOOR):
            return [k for k, t in enumerate(self.things) if t.noun in (DOOR, OPENING)]
        matches = [k for k, t in enumerate(self.things) if called(t.noun, head)]
        if matches or " " not in head:
            return matches
        room, kind = head.rsplit(" ", 1)
        inside = set(self.regions_called(room))
        return [k for k, t in enumerate(self.things) if called(t.noun, kind) and t.region in inside]

    def gap_m(self, k: int) -> Array:
        """Return (R, C) distance of each cell to thing `k` [m]; inf where a wall stands between."""
        if k not in self._gaps:
            thing = self.things[k]
            edge = np.clip(self.centers_m, thing.low_m, thing.high_m)
            gap = np.linalg.norm(self.centers_m - edge, axis=-1)
            near = self.free & (gap <= SIGHT_M)
            open_ = no_wall_between(
                self.centers_m[near], edge[near], gap[near], self._regions, skin_of(thing.noun)
            )
            gap[~near] = np.inf
            gap[near] = np.where(open_ | (gap[near] < 0.3), gap[near], np.inf)
            self._gaps[k] = gap
        return self._gaps[k]

    def regions_called(self, head: str) -> list[int]:
        """Return the regions that may be called so."""
        rooms = ROOM_PHRASES.get(head, frozenset())
        return [k for k, name in enumerate(self.rooms) if name in rooms]


def _thing(noun: str, thing: LabeledObject, regions: RegionMap) -> Thing:
    low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
    around = regions.at(np.stack([low, high, 0.5 * (low + high)]))
    inside = around[around >= 0]
    return Thing(noun, low, high, int(np.bincount(inside).argmax()) if len(inside) else -1)
