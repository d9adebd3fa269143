"""Judge what made a gap in a floor by what lies around it: a defect of the scan, or a real gap."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import Mask
from ...formats.scene.grid import GridSpec
from ..grid.morphology import Window, distance_to, grow, grown_window, label
from .evidence import Evidence

# Regions lying open below in more than this share of their cells are stairwells or shafts.
OPEN_BELOW_SHARE = 0.2
# So are those whose walls go on downwards along more than this share of the rim, with nothing near
# under most of it: the bottom may not have been scanned.
SUNK_SHARE, SUNK_REACH_CELLS = 0.6, 2
# What lies beside an opening along more than this share of its rim, with something close under it,
# is the head of its stairs; a rail or a wall of some cells may stand between.
STAIRS_SHARE, STAIRS_REACH_CELLS = 0.2, 4
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
# A gap that opens to the outside along more of its rim than this is none; under a ceiling, where
# a wall may be missing from the scan, more is tolerated.
OPEN_EDGE, OPEN_EDGE_SHELTERED = 0.05, 0.4


@dataclass(frozen=True)
class Rim:
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
class Surroundings:
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


def look_around(cells: Mask, window: Window, around: Surroundings) -> Rim:
    """Return what lies around a gap: its `cells`, which lie at `window` in the level's grid."""
    evidence, grid = around.evidence, around.grid
    rim = ndimage.binary_dilation(cells) & ~cells
    if not rim.any():
        rim = cells

    def share(mask: Mask, where: Mask) -> float:
        return float(mask[window][where].mean())

    return Rim(
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


def _sides(cells: Mask, window: Window, around: Surroundings) -> int:
    """Return the connected pieces of floor within `SIDE_M` of a gap."""
    reach = round(SIDE_M / around.grid.cell_m)
    wide = grown_window(window, reach, around.grid.shape)
    gap = np.zeros_like(around.rooms[wide])
    top, left = window[0].start - wide[0].start, window[1].start - wide[1].start
    gap[top : top + cells.shape[0], left : left + cells.shape[1]] = cells
    return label((distance_to(gap) <= reach) & around.rooms[wide], diagonal=True)[1]


def judge(rim: Rim, *, ceiled: bool, floored: bool) -> tuple[bool, str, str]:
    """Return whether to fill a gap, its likely cause, and the reason in words.

    `ceiled` says whether the level has ceilings, `floored` whether floor runs on under its walls.
    """
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
