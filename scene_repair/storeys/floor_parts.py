"""Measure level surfaces, and judge which of them are floors."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import I64, Array, Mask
from ...formats.core.geometry import triangle_areas
from ...formats.scene.grid import GridSpec
from ..grid.columns import Columns
from ..grid.morphology import distance_to, grow, grown_window, linked
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from .surfaces import STANDING_M, Surfaces, connected

# A surface this far above a floor that surrounds it is furniture, unless it is large.
FURNITURE_M = (0.15, 1.4)
PLATFORM_M2 = 8.0
# What lies this far around a surface decides whether a room is over or under it.
AROUND_M = 0.3
WALLS_ABOVE_SHARE = 0.5
RISES_M = np.array([0.5, 1.0, 1.5])
# Faces steeper than this are upright: a pitched roof must not pass for the walls over itself.
UPRIGHT_NORMAL_Z = 0.8
# A surface that rises by more than this over a length, in most of its places, is a roof; the
# steepest ramps that people build rise by half as much.
PITCH, PITCH_OVER_M = 0.2, 0.25
# A disc of this radius fits on a floor; what is narrower lies between the faces of a wall, and so
# does the underside of a closed solid that is as wide as the thickest walls.
NARROW_M, THICK_M = 0.3, 0.75
# Treads of a stair rise by no more than this, and a person passes over each.
TREAD_M, PASSAGE_M = 0.3, 1.5


@dataclass(frozen=True)
class FloorParts:
    """Measures of each connected level surface, all (parts,).

    Attributes:
        area_m2, standing_m2: all of it, and where a person can stand.
        height_m: median height.
        above, below: cells in and around it through which upright surfaces pass over and under it:
            a floor has a room's walls over it, a ceiling or a roof has them only under it.
        pitch: median rise over run, 0 if there is no standing room.
        widest_m: radius of the largest disc that fits on it.
        averted_share: share whose faces look down, in a mesh of closed solids.
        ceiled_share: share with a surface somewhere over it.
        walled_share: share of its rim along which walls rise above head height.
        furniture: it stands over a larger floor around it at the height of furniture.
        stairs: number of its group; surfaces of one group are joined by steps.
    """

    area_m2: Array
    standing_m2: Array
    height_m: Array
    above: Array
    below: Array
    pitch: Array
    widest_m: Array
    averted_share: Array
    ceiled_share: Array
    walled_share: Array
    furniture: Mask
    stairs: I64

    def why_no_floor(self, p: int, min_floor_m2: float) -> str:
        """Return why surface `p` is no floor, as the end of a sentence; empty if it is one."""
        if self.standing_m2[p] < min_floor_m2:
            return (
                f"has {self.standing_m2[p]:.2f} m² with free height; valid: at least "
                f"{min_floor_m2:g} m²"
            )
        if self.pitch[p] > PITCH:
            return f"slopes by {100 * self.pitch[p]:.0f} %, like a roof"
        between = THICK_M if self.averted_share[p] > 0.5 else NARROW_M
        if self.widest_m[p] < between:
            return f"is at most {2 * self.widest_m[p]:.2f} m wide, like the inside of a wall"
        return "is furniture on the floor around it" if self.furniture[p] else ""

    def over_walls(self, p: int) -> bool:
        """Return whether surface `p` has walls only under it, like a ceiling or a roof."""
        return bool(self.above[p] < self.below[p] * WALLS_ABOVE_SHARE)


def measure_parts(
    surfaces: Surfaces, columns: Columns, mesh: WorldMesh, min_floor_m2: float
) -> FloorParts:
    """Measure all surfaces; those too small to be a floor only in area and height."""
    grid, count = columns.grid, surfaces.parts
    cell_m2 = grid.cell_m**2

    def share(selected: Mask) -> Array:
        return np.bincount(surfaces.part, selected, count) / np.maximum(samples, 1)

    samples = np.bincount(surfaces.part, minlength=count)
    standing_m2 = np.bincount(surfaces.part, surfaces.clear_m >= STANDING_M, count) * cell_m2
    # Without a single surface to stand on there is nothing to take a median of.
    height: Any = ndimage.median(surfaces.z_m, surfaces.part, np.arange(count)) if count else []
    above, below, pitch, widest, walled = np.zeros((5, count))
    furniture = np.zeros(count, dtype=bool)
    walls = mesh.faces[np.abs(mesh.normals[:, 2]) < UPRIGHT_NORMAL_Z]
    reach = max(1, round(AROUND_M / grid.cell_m))
    upper = np.uint32((1 << len(RISES_M)) - 1)
    area_m2 = (samples * cell_m2).astype(np.float64)
    height_m = np.asarray(height, dtype=np.float64)
    order = np.argsort(surfaces.part, kind="stable")
    ends = np.cumsum(samples)
    row, column = np.divmod(surfaces.cell, grid.columns)
    for p in np.flatnonzero(standing_m2 >= min_floor_m2):
        selected = order[ends[p] - samples[p] : ends[p]]
        i, j = row[selected], column[selected]
        own = (slice(int(i.min()), int(i.max()) + 1), slice(int(j.min()), int(j.max()) + 1))
        window = grown_window(own, reach + 1, grid.shape)
        top, left = window[0].start, window[1].start
        z = np.full((window[0].stop - top, window[1].stop - left), np.nan)
        z[i - top, j - left] = surfaces.z_m[selected]
        pitch[p] = _pitch(z, grid)
        surface = np.isfinite(z)
        widest[p] = float(distance_to(~np.pad(surface, 1)).max()) * grid.cell_m
        near = grow(surface, reach)
        heights = height_m[p] + np.concatenate([RISES_M, -RISES_M])
        marks = slice_marks(mesh.vertices, walls, grid, heights, window)
        above[p] = np.bitwise_count(marks[near] & upper).sum()
        below[p] = np.bitwise_count(marks[near] & ~upper).sum()
        rim = grow(surface) & ~surface
        walled[p] = grow((marks & upper) == upper, reach)[rim].mean() if rim.any() else 0.0
        rise = height_m[p] - height_m
        lower = (rise > FURNITURE_M[0]) & (rise < FURNITURE_M[1]) & (area_m2 > area_m2[p])
        if area_m2[p] < PLATFORM_M2 and lower.any():
            under = np.zeros(grid.shape, dtype=bool)
            under.ravel()[surfaces.cell[lower[surfaces.part]]] = True
            furniture[p] = (near & under[window]).any()
    corners = mesh.vertices[mesh.faces] - mesh.vertices[mesh.faces[:1, 0]]
    # Positive if closed solids look outwards.
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    down = (mesh.normals[:, 2] < 0) & (volume > 0)
    return FloorParts(
        area_m2=area_m2,
        standing_m2=standing_m2.astype(np.float64),
        height_m=height_m,
        above=above,
        below=below,
        pitch=pitch,
        widest_m=widest,
        averted_share=share(down[surfaces.face]),
        ceiled_share=share(np.isfinite(surfaces.clear_m)),
        walled_share=walled,
        furniture=furniture,
        stairs=_stairs(surfaces, grid),
    )


def _pitch(z_m: Array, grid: GridSpec) -> float:
    """Return the median slope of a surface (rows, columns) with NaN outside it."""
    run = max(1, round(PITCH_OVER_M / grid.cell_m))
    along = z_m[run:, :-run] - z_m[:-run, :-run]
    across = z_m[:-run, run:] - z_m[:-run, :-run]
    slope = np.hypot(along, across) / (run * grid.cell_m)
    finite = np.isfinite(slope)
    return float(np.median(slope[finite])) if finite.any() else 0.0


def _stairs(surfaces: Surfaces, grid: GridSpec) -> I64:
    """Return for each surface a number that surfaces joined by steps share."""
    open_ = surfaces.clear_m >= PASSAGE_M
    group = connected(surfaces.cell[open_], surfaces.z_m[open_], grid, TREAD_M)
    # Furniture divides what can be passed of a surface; the surface joins it again.
    own, other = surfaces.part[open_], surfaces.parts + group
    count = surfaces.parts + int(group.max(initial=-1)) + 1
    return linked(own, other, count)[: surfaces.parts]


def walls_begin_m(mesh: WorldMesh) -> float | None:
    """Return the height at which most upright faces begin; None if there are none."""
    walls = mesh.faces[np.abs(mesh.normals[:, 2]) < UPRIGHT_NORMAL_Z]
    if not len(walls):
        return None
    corners = mesh.vertices[walls]
    low = np.round(corners[..., 2].min(axis=1), 2)
    heights, index = np.unique(low, return_inverse=True)
    return float(heights[np.argmax(np.bincount(index, triangle_areas(corners)))])
