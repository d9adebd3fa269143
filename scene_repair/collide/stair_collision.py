"""The sheet of a staircase: treads, landings and aprons of floor, and what stands over them."""

from dataclasses import dataclass, replace

import numpy as np

from ...formats.core.arrays import Array, Mask
from ...formats.core.frames import in_plan_frame
from ...formats.scene.bundle import Floor
from ...formats.scene.freemap import Freemap
from ...formats.scene.grid import GridSpec
from ...formats.scene.staircase import Staircase, Treads
from ..config import RepairConfig
from ..grid.height_field import extend
from ..grid.morphology import label
from ..grid.world_mesh import WorldMesh
from ..storeys.flights import Flight
from ..storeys.staircases import EDGE_M, ScannedStaircase
from ..storeys.treads import STEP_UP_M
from .level_collision import LevelCollision, build_collision, cropped

# Aprons of floor reach this far before the foot and behind the head, and to both sides.
APRON_M, BESIDE_M = 1.0, 0.3
# The middle line begins and ends on them, if it can, this far from the riser and from all else.
TURNING_M = 0.45
# What differs by less from the height at a flight's end is floor there.
AT_END_M = 0.1
# Edges of treads jut out and are rounded: so near to a step, what is no higher is no obstacle.
NOSING_M = 0.075
# So far the middle line leaves a flight's middle at its end, where something stands on one side.
_MOST_ASIDE_M = 0.2
# A staircase is blocked if nothing this wide and high passes.
PASSING_M = (0.5, 0.6)


@dataclass(frozen=True)
class RepairedStaircase:
    """A staircase, its flights, its sheet as of a level, and its boxes.

    Only a climbable one has `sheet` and `treads`.
    """

    staircase: Staircase
    flights: tuple[Flight, ...]
    sheet: LevelCollision | None
    treads: Treads | None


def build_stairs(
    mesh: WorldMesh,
    scanned: ScannedStaircase,
    levels: list[LevelCollision],
    fine: GridSpec,
    config: RepairConfig,
) -> RepairedStaircase:
    """Build the sheet of a staircase on cells of `fine`, and look whether one can climb it.

    Args:
        mesh: with the repairs of all levels.
        levels: the collision of all levels, lowest first.
    """
    staircase, flights = scanned.staircase, scanned.flights
    if scanned.treads is None:
        return RepairedStaircase(staircase, flights, None, None)
    lower, upper = (levels[k].floor for k in staircase.levels)
    foot = _Apron(flights[0], flights[0].foot_world_m, -flights[0].ahead, lower)
    head = _Apron(flights[-1], flights[-1].head_world_m, flights[-1].ahead, upper)
    floor, treads = _lay(scanned.treads, foot, head, fine)
    sheet = build_collision(mesh, floor, config, _over_steps(floor))
    freemap = _between(_without_cliffs(sheet.freemap), foot, head)
    if freemap is None:
        width, height = PASSING_M
        problem = f"is blocked: nothing {width:g} m wide and {height:g} m high passes"
        return RepairedStaircase(replace(staircase, problem=problem), flights, None, None)
    line = staircase.line_world_m.copy()
    for end, outer, apron in ((1, 0, foot), (-2, -1, head)):
        line[end, :2] += _aside(line[end], apron, freemap)
        line[outer] = replace(apron, end_m=line[end]).place(freemap)
    staircase = replace(staircase, line_world_m=line)
    return RepairedStaircase(staircase, flights, replace(sheet, freemap=freemap), treads)


def _aside(end_m: Array, apron: "_Apron", freemap: Freemap) -> Array:
    """Return how far (2,) [m] to move a flight's end (3,) into the middle of what is free there.

    A door frame or a post may stand on one side of where a flight ends.
    """
    low = freemap.for_height(PASSING_M[1])
    steps = np.arange(0.0, TURNING_M, low.grid.cell_m)
    shifts = np.arange(-_MOST_ASIDE_M, _MOST_ASIDE_M + 1e-9, low.grid.cell_m)
    across = np.array([-apron.away[1], apron.away[0]])
    places = end_m[:2] + steps[:, None, None] * apron.away + shifts[:, None] * across
    cells = low.grid.clamped_cell_of(places)
    narrowest = low.clearance_m[cells[..., 0], cells[..., 1]].min(axis=0)
    # Not farther than need be: beyond `TURNING_M` of space more is no better.
    best = int(np.argmax(np.minimum(narrowest, TURNING_M) - 0.1 * np.abs(shifts)))
    return shifts[best] * across


def _lay(treads: Treads, foot: "_Apron", head: "_Apron", fine: GridSpec) -> tuple[Floor, Treads]:
    """Return the floor of treads, landings and aprons, and the boxes with the last at its height.

    The last box is the edge of the upper floor.
    """
    center, half = treads.center_m.copy(), treads.half_m
    around = np.linalg.norm(half[:, :2], axis=1).max() + APRON_M + 2 * BESIDE_M
    low = fine.clamped_cell_of(center[:, :2].min(axis=0) - around)
    size = fine.clamped_cell_of(center[:, :2].max(axis=0) + around) - low + 1
    x, y = (fine.center_of(low) - fine.cell_m / 2).tolist()
    grid = GridSpec((x, y), fine.cell_m, int(size[0]), int(size[1]))
    xy = _centers(grid)
    height = np.full(grid.shape, np.nan)
    foot.lay(height, xy, head)
    head.lay(height, xy, foot)
    center[-1, 2] = float(np.median(height[head.core(xy)])) - half[-1, 2]
    treads = replace(treads, center_m=center)
    steps = treads.without_edge
    for inside, top_m in zip(steps.holds(xy), steps.top_m, strict=True):
        height[inside] = np.fmax(height[inside], top_m)
    return cropped(Floor(grid, extend(height).astype(np.float32), np.isfinite(height))), treads


def _centers(grid: GridSpec) -> Array:
    """Return the centres (rows, columns, 2) [m] of all cells."""
    return grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1))


@dataclass(frozen=True)
class _Apron:
    """Floor of a level at one end of a staircase: `away` (2,) leads from its `end_m` (3,)."""

    flight: Flight
    end_m: Array
    away: Array
    level: Floor

    def _strip(self, xy: Array, length_m: float, beside_m: float) -> Mask:
        right, left = self.flight.sides_m
        if self.away @ self.flight.ahead < 0:
            right, left = left, right
        yaw = float(np.arctan2(self.away[1], self.away[0]))
        low, high = np.array([0.0, -right - beside_m]), np.array([length_m, left + beside_m])
        own = in_plan_frame(xy, self.end_m[:2], yaw)
        return np.all((own >= low) & (own < high), axis=-1)

    def core(self, xy: Array) -> Mask:
        """Return the cells that are floor even where the scan has none."""
        return self._strip(xy, EDGE_M, 0.0)

    def cells(self, freemap: Freemap) -> Mask:
        """Return the cells (rows, columns) of a map that lie on the apron, at its height."""
        near = np.abs(freemap.floor_z_m - self.end_m[2]) < AT_END_M
        return near & self._strip(_centers(freemap.grid), APRON_M, BESIDE_M)

    def place(self, freemap: Freemap) -> Array:
        """Return (3,) where one turns towards the flight: with space around, and not far aside."""
        low = freemap.for_height(PASSING_M[1])
        cells = np.argwhere(self.cells(freemap) & low.traversable)
        xy = freemap.grid.center_of(cells)
        from_end = xy - self.end_m[:2]
        along = from_end @ self.away
        aside = np.abs(from_end @ (-self.away[1], self.away[0]))
        clear = np.minimum(low.clearance_m[tuple(cells.T)], TURNING_M)
        best = int(np.argmax(clear - 0.3 * aside - 0.2 * np.abs(along - TURNING_M)))
        return np.array([*xy[best], float(freemap.floor_z_m[tuple(cells[best])])])

    def lay(self, height_m: Array, xy: Array, other: "_Apron") -> None:
        """Write the apron's heights; beside the flight only where the other apron is not."""
        beyond = other._strip(xy, APRON_M + BESIDE_M, 2 * BESIDE_M)
        area = self._strip(xy, APRON_M, BESIDE_M) & ~beyond
        area |= self._strip(xy, APRON_M, 0.0)
        cells = tuple(np.moveaxis(self.level.grid.clamped_cell_of(xy[area]), -1, 0))
        z = self.level.height_m[cells].astype(np.float64)
        at_end = np.abs(z - self.end_m[2]) < AT_END_M
        core = self.core(xy)[area]
        z = np.where(at_end, z, np.where(core, self.end_m[2], np.nan))
        height_m[area] = np.where(core | self.level.covered[cells], z, np.nan)


def _over_steps(floor: Floor) -> Array:
    """Return the height (rows, columns) of the highest step up beside each cell, or its own."""
    height = floor.height_m.astype(np.float64)
    reach = round(NOSING_M / floor.grid.cell_m)
    padded = np.pad(height, reach, mode="edge")
    result = height.copy()
    rows, columns = height.shape
    for i in range(2 * reach + 1):
        for j in range(2 * reach + 1):
            near = padded[i : i + rows, j : j + columns]
            result = np.where(near - height <= STEP_UP_M, np.maximum(result, near), result)
    return result


def _without_cliffs(freemap: Freemap) -> Freemap:
    """Return the map without the cells beside floor that is more than a step higher or lower."""
    padded = np.pad(freemap.floor_z_m, 1, constant_values=np.nan)
    rows, columns = freemap.grid.shape
    cliff = np.zeros(freemap.grid.shape, dtype=bool)
    for i in range(3):
        for j in range(3):
            step = np.abs(padded[i : i + rows, j : j + columns] - freemap.floor_z_m)
            cliff |= step > STEP_UP_M
    return _only(freemap, ~cliff)


def _only(freemap: Freemap, cells: Mask) -> Freemap:
    """Return the map with nothing free outside `cells`, for robots of any height."""
    return replace(
        freemap,
        traversable=freemap.traversable & cells,
        headroom_m=np.where(cells, freemap.headroom_m, np.float32(0.0)),
    )


def _between(freemap: Freemap, foot: _Apron, head: _Apron) -> Freemap | None:
    """Return what is connected with both ends of a staircase; None if nothing is."""
    width, height = PASSING_M
    low = freemap.for_height(height)
    parts, _ = label(low.free(width / 2))
    joined = np.intersect1d(parts[foot.cells(freemap)], parts[head.cells(freemap)])
    joined = joined[joined > 0]
    if not len(joined):
        return None
    whole, _ = label(low.traversable)
    return _only(freemap, np.isin(whole, np.unique(whole[np.isin(parts, joined)])))
