"""The exact area that patches may cover: filled cells, up to the rim and the walls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...formats.scene.grid import GridSpec
from ..grid.morphology import Mask, Window, grow, grown_window, label, windows
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from .evidence import WALL_HEIGHTS_M
from .outline import cell_polygons

# Cells are divided by this, so that a patch ends within millimetres of a wall's face.
DIVIDE = 4
# About as large as what is asked for.
TILE_M = 1.0


@dataclass(frozen=True)
class Region:
    """One connected area as sub-cells of a window.

    Attributes:
        cells: (rows, columns) bool.
        grid: their grid, only over the window.
    """

    cells: Mask
    grid: GridSpec

    def polygons_m(self) -> list[NDArray[np.float64]]:
        """Return the outlines in world coordinates."""
        rows, columns = self.cells.shape
        return cell_polygons(self.cells, (slice(0, rows), slice(0, columns)), self.grid)

    def bounds_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper corner (2,) [m]."""
        return _bounds(self.grid)


def patch_region(
    mesh: WorldMesh, *, fill: Mask, reach: Mask, wall: Mask, grid: GridSpec, floor_z_m: float
) -> list[Region]:
    """Return the areas to cover, one per connected group of filled cells.

    Each is the filled cells and a seam of one cell around, in which the patch finds the floor's
    rim; in cells of walls the seam ends at the wall's face.

    Args:
        fill: (rows, columns) cells to fill.
        reach: (rows, columns) cells that the seam may enter.
        wall: (rows, columns) cells in which a wall stands.
    """
    upright = mesh.vertices[_upright_faces(mesh, floor_z_m)]
    tiles = Tiles(upright[..., :2].min(axis=1), upright[..., :2].max(axis=1))
    parts, _ = label(grow(fill))
    regions = []
    for k, window in enumerate(windows(parts), start=1):
        around = grown_window(window, 1, grid.shape)
        selected = fill[around] & (parts[around] == k)
        seam = grow(selected) & reach[around] & ~selected
        local = _sub_grid(around, grid)
        inner = _divide(selected)
        if (seam & wall[around]).any():
            near = upright[tiles.near(*_bounds(local))].reshape(-1, 3)
            heights = floor_z_m + WALL_HEIGHTS_M
            face = slice_marks(near, np.arange(len(near)).reshape(-1, 3), local, heights) > 0
            open_seam = _divide(seam) & ~(face & _divide(wall[around]))
            cross = ndimage.generate_binary_structure(2, 1)
            inner = ndimage.binary_dilation(
                inner, structure=cross, iterations=2 * DIVIDE, mask=inner | open_seam
            )
        else:
            inner = inner | _divide(seam)
        regions.append(Region(inner, local))
    return regions


def _sub_grid(window: Window, grid: GridSpec) -> GridSpec:
    x, y = grid.origin_xy_m
    rows, columns = window
    return GridSpec(
        (x + columns.start * grid.cell_m, y + rows.start * grid.cell_m),
        grid.cell_m / DIVIDE,
        (rows.stop - rows.start) * DIVIDE,
        (columns.stop - columns.start) * DIVIDE,
    )


def _divide(mask: Mask) -> Mask:
    return np.repeat(np.repeat(mask, DIVIDE, axis=0), DIVIDE, axis=1)


def _bounds(grid: GridSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low = np.asarray(grid.origin_xy_m)
    return low, low + np.array([grid.columns, grid.rows]) * grid.cell_m


def _upright_faces(mesh: WorldMesh, floor_z_m: float) -> NDArray[np.int64]:
    """Return the faces (n, 3) that cross any of the heights at which walls are detected."""
    z = mesh.vertices[mesh.faces, 2] - floor_z_m
    first = np.searchsorted(WALL_HEIGHTS_M, z.min(axis=1))
    last = np.searchsorted(WALL_HEIGHTS_M, z.max(axis=1), side="right")
    return mesh.faces[last > first]


class Tiles:
    """Rectangles along the axes (the bounds of faces from above), filed by the tiles they touch.

    Args:
        lower_m: (N, 2) corners.
        upper_m: (N, 2) corners, not below `lower_m`.
    """

    def __init__(self, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]):
        self.lower_m, self.upper_m = lower_m, upper_m
        self.origin = lower_m.min(axis=0) if len(lower_m) else np.zeros(2)
        first, last = self._tile(lower_m), self._tile(upper_m)
        self.shape = last.max(axis=0) + 1 if len(last) else np.zeros(2, dtype=np.int64)
        wide = last - first + 1
        count = wide.prod(axis=1)
        item = np.repeat(np.arange(len(lower_m)), count)
        step = np.arange(len(item)) - np.repeat(np.cumsum(count) - count, count)
        x = first[item, 0] + step % wide[item, 0]
        y = first[item, 1] + step // wide[item, 0]
        tile = y * self.shape[0] + x
        order = np.argsort(tile, kind="stable")
        self.item = item[order]
        self.start = np.searchsorted(tile[order], np.arange(int(self.shape.prod()) + 1))

    def near(self, lower_m: NDArray[np.float64], upper_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the sorted indices (n,) of rectangles that touch the given one."""
        x0, y0 = np.maximum(self._tile(lower_m), 0)
        x1, y1 = np.minimum(self._tile(upper_m), self.shape - 1)
        if x1 < x0 or y1 < y0:
            return np.empty(0, dtype=np.int64)
        rows = [y * self.shape[0] for y in range(y0, y1 + 1)]
        found = np.concatenate(
            [self.item[self.start[r + x0] : self.start[r + x1 + 1]] for r in rows]
        )
        found = np.unique(found)
        touches = (self.upper_m[found] >= lower_m) & (self.lower_m[found] <= upper_m)
        return found[touches.all(axis=1)]

    def _tile(self, xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
        return np.floor((xy_m - self.origin) / TILE_M).astype(np.int64)
