"""Gaps in a level's floor: defects that a person would expect to be floor, and real openings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...formats.scene.grid import GridSpec
from ..collide.free_space import places
from ..grid.morphology import Mask, Window, distance_to, grow, grown_window, label, windows
from .evidence import Evidence

# The outside is what a disc of this radius reaches from beyond the building; doors keep it out.
OUTSIDE_RADIUS_M = 0.5
# Walls have gaps where furniture or curtains hid them; shorter ones along x or y are closed.
WALL_GAP_M = 2.5
WALL_RUN_M = 0.3
# Regions lying open below in more than this share of their cells are stairwells or shafts.
OPEN_BELOW_SHARE = 0.2
# So are those whose walls go on downwards along more than this share of the rim, with nothing near
# under most of it: the bottom may not have been scanned.
SUNK_SHARE, SUNK_REACH_CELLS = 0.6, 2
# What lies beside an opening along more than this share of its rim, with something close under it,
# is the head of its stairs; a rail or a wall of some cells may stand between.
STAIRS_SHARE, STAIRS_REACH_CELLS = 0.2, 4
# If floor lies in more than this share of the cells between walls' faces, it runs on under walls.
FLOORED_WALLS_SHARE = 0.5
# A level has ceilings if they hang over this share of its floor.
CEILED_SHARE = 0.6
# A gap walled in along this share of its rim is a shaft, a courtyard or a wall's inside …
WALLED_SHARE = 0.8
# What lies between a wall's faces has them along this share of its rim at least.
BETWEEN_FACES_SHARE = 0.5
# … unless something stands in it that is thicker than a wall: a wardrobe.
WALL_THICKNESS_M = 0.3
SHAFT_M = 0.75  # shafts are at least this wide; cupboards, whose sides look like walls, are not
# Walls, lintels and the outside make up this share of the rim of a window's niche: where a sill is
# labelled as such, and where it could be any shelf.
SILL_CLOSED_SHARE, NICHE_CLOSED_SHARE = 0.5, 0.85
# Parted from the floor along this share of its rim a thin gap is part of a wall, unless floor lies
# within this distance on two sides of it: then it is a doorway.
PARTED_SHARE, SIDE_M = 0.95, 0.25
# Without a ceiling above, in a building that has ceilings, only smaller gaps are scan defects.
SKYLIGHT_M2 = 1.0
# A gap that opens to the outside along more of its rim than this is no hole; under a ceiling, where
# a wall may be missing from the scan, more is tolerated.
OPEN_EDGE, OPEN_EDGE_SHELTERED = 0.05, 0.4
# A ceiling proves an inside this far from known floor.
UNDER_CEILING_REACH_M = 1.0


@dataclass(frozen=True)
class Hole:
    """One connected gap.

    Attributes:
        cells: (rows, columns) bool over the level's fine grid, cropped to `window`.
        window: where `cells` lies in the grid.
        fill: whether it is to be filled.
        cause: what most likely made it.
        reason: why it is filled or left.
        added_m2: area of the triangles that fill it; they reach to the rim and to walls' faces.
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


@dataclass(frozen=True)
class _Rim:
    """Shares of a gap's rim, and of what lies over and under its cells.

    `sides` is the number of connected pieces of floor that lie near; `joined` says whether no wall
    stands between it and floor that has room for a robot.
    """

    floor: float
    wall: float
    line: float
    outside: float
    overhead: float
    furniture: float
    structure: float
    below: float
    bare: float
    sunk: float
    area_m2: float
    thickness_m: float
    sides: int
    opening: float
    joined: bool


@dataclass(frozen=True)
class _Around:
    """What gaps are judged by: cells (rows, columns) of the whole level.

    `floor` counts floor also under lintels and bridged walls, `rooms` only away from any wall;
    `openings` are gaps that were found to be such, `joined` everything that no wall parts from
    floor with room for a robot.
    """

    evidence: Evidence
    grid: GridSpec
    floor: Mask
    line: Mask
    rooms: Mask
    outside: Mask
    openings: Mask
    joined: Mask


def find_holes(evidence: Evidence, grid: GridSpec) -> tuple[list[Hole], Mask]:
    """Return all gaps inside the building, each judged.

    Returns:
        The gaps, and the (rows, columns) cells under lintels and bridged pieces of wall, which part
        gaps but are no gaps themselves.
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
            filled = _filled(covered, holes + judged)
            floor = filled | (passable & grow(filled, 2))
            openings = _openings(holes + judged, grid)
            around = _Around(evidence, grid, floor, line, filled & ~line, outside, openings, joined)
            judged = [
                Hole(*place, *_judge(_look_around(*place, around), ceiled, floored))
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
        between |= ndimage.binary_closing(wall, np.ones(size))
    between = (between & ~wall)[steps:-steps, steps:-steps] & ~evidence.furniture
    return bool(between.any() and evidence.covered[between].mean() > FLOORED_WALLS_SHARE)


def _filled(covered: Mask, holes: list[Hole]) -> Mask:
    """Return the floor with the gaps that are to be filled."""
    floor = covered.copy()
    for hole in holes:
        floor[hole.window] |= hole.cells & hole.fill
    return floor


def _openings(holes: list[Hole], grid: GridSpec) -> Mask:
    """Return the gaps that are openings, and a little around them."""
    found = np.zeros(grid.shape, dtype=bool)
    for hole in holes:
        if hole.cause == "opening":
            found[hole.window] |= hole.cells
    return grow(found, STAIRS_REACH_CELLS) if found.any() else found


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
        wide = np.pad(ndimage.binary_dilation(along, np.ones((3, 1))), steps)
        straight = ndimage.binary_opening(wide, np.ones((1, run)))
        closed = ndimage.binary_closing(straight, np.ones((1, steps)))
        thin = ndimage.binary_erosion(closed, np.ones((3, 1)))[steps:-steps, steps:-steps]
        bridged |= thin.T if turn else thin
    return bridged & ~evidence.covered


def _gaps(evidence: Evidence, line: Mask, grid: GridSpec) -> tuple[Mask, Mask]:
    """Return the cells without floor inside the building's outline, walls apart.

    And the outside.
    """
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


def _look_around(cells: Mask, window: Window, around: _Around) -> _Rim:
    evidence, grid = around.evidence, around.grid
    rim = ndimage.binary_dilation(cells) & ~cells
    if not rim.any():
        rim = cells

    def share(mask: Mask, where: Mask) -> float:
        return float(mask[window][where].mean())

    return _Rim(
        # A wall may stand on the floor at its edge; what lies beyond it is parted from that floor.
        floor=share(around.floor & ~evidence.wall, rim),
        wall=share(evidence.wall, rim),
        line=share(around.line & ~evidence.covered, rim),
        outside=share(around.outside, rim),
        overhead=share(evidence.overhead, cells),
        furniture=share(evidence.furniture, cells),
        structure=share(evidence.structure, cells),
        below=share(evidence.below, cells),
        bare=share(evidence.bare, cells),
        sunk=float(grow(evidence.sunk[window], SUNK_REACH_CELLS)[rim].mean()),
        area_m2=float(cells.sum()) * grid.cell_m**2,
        thickness_m=2.0 * float(distance_to(~np.pad(cells, 1)).max()) * grid.cell_m,
        sides=_sides(cells, window, around),
        opening=float(around.openings[window][rim].mean()),
        joined=bool(around.joined[window][cells].any()),
    )


def _sides(cells: Mask, window: Window, around: _Around) -> int:
    """Return the connected pieces of floor within `SIDE_M` of a gap."""
    reach = round(SIDE_M / around.grid.cell_m)
    wide = grown_window(window, reach, around.grid.shape)
    gap = np.zeros_like(around.rooms[wide])
    top, left = window[0].start - wide[0].start, window[1].start - wide[1].start
    gap[top : top + cells.shape[0], left : left + cells.shape[1]] = cells
    return label((distance_to(gap) <= reach) & around.rooms[wide], diagonal=True)[1]


def _judge(rim: _Rim, ceiled: bool, floored: bool) -> tuple[bool, str, str]:
    """Return whether to fill, the likely cause, and the reason in words."""
    thin = rim.thickness_m < WALL_THICKNESS_M
    # Between a wall's faces lies the wall of the storey below, or what hides in it: no opening.
    if not (thin and rim.wall >= BETWEEN_FACES_SHARE):
        if rim.below >= OPEN_BELOW_SHARE and rim.furniture < 0.5:
            return False, "opening", f"deeper surfaces lie under {100 * rim.below:.0f} %"
        if rim.sunk >= SUNK_SHARE and rim.bare >= 0.5:
            return False, "opening", f"walls go on downwards along {100 * rim.sunk:.0f} %"
        if rim.opening >= STAIRS_SHARE and rim.bare < 0.5:
            beside = f"beside an opening along {100 * rim.opening:.0f} %: its stairs"
            return False, "opening", beside
    tolerated = OPEN_EDGE_SHELTERED if ceiled and rim.overhead >= 0.5 else OPEN_EDGE
    if rim.outside > tolerated:
        return False, "outside", f"open to the outside along {100 * rim.outside:.0f} %"
    # Walls and lintels close in on a niche; along a room's wall floor lies on the other side.
    closed = rim.line + rim.outside
    if rim.structure >= 0.5 and closed >= SILL_CLOSED_SHARE:
        return False, "wall", f"a sill lies over {100 * rim.structure:.0f} %"
    walled = rim.wall >= WALLED_SHARE or rim.floor < 0.03
    if rim.thickness_m >= SHAFT_M and not rim.joined and rim.furniture < 0.5:
        return False, "walled off", "walls part it from all floor that has room for a robot"
    if thin:
        # Real walls: a strip of a courtyard between bridged walls has no floor around it, either.
        if walled and floored and rim.wall >= BETWEEN_FACES_SHARE:
            return True, "at a wall", "under a wall, in a scan whose floors run on under walls"
        if walled:
            return False, "wall", f"walled in along {100 * rim.wall:.0f} %, as thin as a wall"
        if closed >= PARTED_SHARE and rim.sides < 2:
            return False, "wall", "walls and lintels around it, floor on one side only"
        if rim.furniture >= 0.5 and closed >= NICHE_CLOSED_SHARE:
            return False, "wall", "a window's niche: a sill lies over it, a wall around it"
        if ceiled and rim.overhead + rim.furniture < 0.5 and rim.line >= 0.3:
            return False, "wall", "between a wall's faces: thin, and no ceiling above"
    cause = "scan gap"
    if rim.furniture >= 0.5:
        cause = "under furniture"
    elif rim.wall >= 0.1:
        cause = "at a wall"
    if rim.furniture >= 0.5:
        return True, cause, f"furniture stands over {100 * rim.furniture:.0f} %"
    if rim.overhead + rim.furniture >= 0.5:
        return True, cause, f"a ceiling or a thing hangs over {100 * rim.overhead:.0f} %"
    if ceiled and (rim.floor < 0.25 or rim.area_m2 >= SKYLIGHT_M2):
        return False, "open air", "no ceiling above, in a building that has ceilings"
    if walled:
        return False, "open air", f"walled in along {100 * rim.wall:.0f} %, nothing above"
    if rim.floor < 0.2:
        return False, "outside", f"floor along only {100 * rim.floor:.0f} % of its rim"
    return True, cause, f"floor around {100 * rim.floor:.0f} % of its rim"
