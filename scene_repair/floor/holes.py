"""Gaps in a level's floor: defects that a person would expect to be floor, and real openings."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Mask
from ...formats.scene.grid import GridSpec
from ..collide.free_space import places
from ..grid.morphology import (
    Window,
    closing,
    dilated,
    distance_to,
    eroded,
    grow,
    grown_window,
    label,
    opening,
    windows,
)
from .causes import STAIRS_REACH_CELLS, WALL_THICKNESS_M, Surroundings, judge, look_around
from .evidence import Evidence

# The outside is what a disc of this radius reaches from beyond the building; doors keep it out.
OUTSIDE_RADIUS_M = 0.5
# Walls have gaps where furniture or curtains hid them; shorter ones along x or y are closed.
WALL_GAP_M = 2.5
WALL_RUN_M = 0.3
# If floor lies in more than this share of the cells between walls' faces, it runs on under walls.
FLOORED_WALLS_SHARE = 0.5
# A level has ceilings if they hang over this share of its floor.
CEILED_SHARE = 0.6
# A ceiling proves an inside this far from known floor.
UNDER_CEILING_REACH_M = 1.0


@dataclass(frozen=True)
class Hole:
    """One connected gap, its likely cause and the area of the triangles that fill it.

    `cells` lie in `window` of the fine grid; triangles reach to the rim and to walls' faces.
    """

    cells: Mask
    window: Window
    fill: bool
    cause: str
    reason: str
    added_m2: float = 0.0

    def area_m2(self, grid: GridSpec) -> float:
        """Return the area [m²] by cells."""
        return float(self.cells.sum()) * grid.cell_m**2


def find_holes(evidence: Evidence, grid: GridSpec) -> tuple[list[Hole], Mask]:
    """Return all gaps inside the building, each judged, and what parts them without being a gap.

    The latter are (rows, columns) cells under lintels and bridged pieces of wall.
    """
    line = evidence.wall | evidence.lintel | _bridges(evidence, grid)
    gaps, outside = _gaps(evidence, line, grid)
    covered = evidence.covered
    ceiled = bool(covered.any() and evidence.overhead[covered].mean() >= CEILED_SHARE)
    floored = floors_run_under_walls(evidence, grid)
    sheltered = evidence.overhead | evidence.furniture
    # Where ceilings exist, what lies under one and what does not are different things: a gap in
    # a room's floor, and the inside of the wall next to it.
    classes = [gaps & sheltered, gaps & ~sheltered] if ceiled else [gaps]
    holes: list[Hole] = []
    # What only passes overhead does not part a gap from the floor next to it.
    passable = line & ~evidence.wall
    joined = _joined(evidence, gaps | passable, grid)
    for cells in classes:
        region, _ = label(cells)
        places = [
            (region[grown] == k, grown)
            for k, window in enumerate(windows(region), start=1)
            for grown in [grown_window(window, 1, grid.shape)]
        ]
        judged: list[Hole] = []
        # Twice: next to a gap that is filled lies floor.
        for _ in range(2):
            filled, openings = covered.copy(), np.zeros(grid.shape, dtype=bool)
            for hole in holes + judged:
                filled[hole.window] |= hole.cells & hole.fill
                openings[hole.window] |= hole.cells & (hole.cause == "opening")
            floor = filled | (passable & grow(filled, 2))
            openings = grow(openings, STAIRS_REACH_CELLS) if openings.any() else openings
            rooms = filled & ~line
            around = Surroundings(evidence, grid, floor, line, rooms, outside, openings, joined)
            judged = [
                Hole(*place, *judge(look_around(*place, around), ceiled=ceiled, floored=floored))
                for place in places
            ]
        holes += judged
    return holes, passable


def floors_run_under_walls(evidence: Evidence, grid: GridSpec) -> bool:
    """Return whether floor lies between the faces of most walls, as in modelled buildings.

    What has a surface below head height is no wall: the risers of a stair are as near to each other
    as the faces of a wall, and the floor runs on under it.
    """
    steps = round(WALL_THICKNESS_M / grid.cell_m)
    wall = np.pad(evidence.wall, steps)
    between = np.zeros_like(wall)
    for size in ((1, steps), (steps, 1)):
        between |= closing(wall, size)
    between = (between & ~wall)[steps:-steps, steps:-steps] & ~evidence.furniture
    return bool(between.any() and evidence.covered[between].mean() > FLOORED_WALLS_SHARE)


def _joined(evidence: Evidence, gaps: Mask, grid: GridSpec) -> Mask:
    """Return the gaps and floor that no wall parts from floor with room for a robot."""
    stand = evidence.covered & ~evidence.wall
    parts, count = label((stand | gaps) & ~evidence.wall)
    joined = np.zeros(count + 1, dtype=bool)
    joined[np.unique(parts[places(stand, grid.cell_m)])] = True
    joined[0] = False
    return joined[parts]


def _bridges(evidence: Evidence, grid: GridSpec) -> Mask:
    """Return the cells without floor that continue a wall across a gap, along x or y."""
    line = evidence.wall | evidence.lintel
    steps = round(WALL_GAP_M / grid.cell_m)
    # A line of wall must already run this far on both sides, or furniture would make walls.
    run = round(WALL_RUN_M / grid.cell_m)
    bridged = np.zeros(grid.shape, dtype=bool)
    for turn in (False, True):
        along = line.T if turn else line
        # Scanned walls waver by a cell; widened for the search, the bridge is thinned again.
        wide = np.pad(dilated(along, (3, 1)), steps)
        closed = closing(opening(wide, (1, run)), (1, steps))
        thin = eroded(closed, (3, 1))[steps:-steps, steps:-steps]
        bridged |= thin.T if turn else thin
    return bridged & ~evidence.covered


def _gaps(evidence: Evidence, line: Mask, grid: GridSpec) -> tuple[Mask, Mask]:
    """Return the cells without floor inside the building's outline, without walls; the outside."""
    empty = ~evidence.covered & ~line
    radius = OUTSIDE_RADIUS_M / grid.cell_m
    pad = int(np.ceil(radius)) + 2
    padded = np.pad(empty, pad, constant_values=True)
    parts, _ = label(distance_to(~padded) > radius)
    outside = distance_to(parts == parts[0, 0]) <= radius
    inside = empty & ~outside[pad:-pad, pad:-pad]
    # Where a wall is missing the outside seems to reach in; a ceiling shows otherwise.
    sheltered = empty & evidence.overhead
    near = evidence.covered | inside
    reached = grow(near, round(UNDER_CEILING_REACH_M / grid.cell_m), within=sheltered | near)
    gaps = inside | (reached & sheltered)
    # What is now shut off from the outside is a gap as well.
    parts, _ = label(np.pad(empty & ~gaps, 1, constant_values=True))
    gaps |= empty & (parts != parts[0, 0])[1:-1, 1:-1]
    return gaps, empty & ~gaps
