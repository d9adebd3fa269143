"""The exact area that patches may cover: filled cells, up to the rim and the walls."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...formats.core.arrays import I64, Array, Mask
from ...formats.scene.grid import GridSpec
from ..grid.morphology import Window, grow, grown_window, label, windows
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from .evidence import WALL_HEIGHTS_M

# Cells are divided by this, so that a patch ends within millimetres of a wall's face.
DIVIDE = 4


def patch_region(
    mesh: WorldMesh, *, fill: Mask, reach: Mask, wall: Mask, grid: GridSpec, floor_z_m: float
) -> list[tuple[Mask, GridSpec]]:
    """Return the areas to cover, one per connected group of cells to `fill`, on grids of their own.

    Each is the filled cells and a seam of one cell around that lies in `reach`, in which the patch
    finds the floor's rim; in cells of a `wall` the seam ends at the wall's face.
    """
    # Faces that cross any of the heights at which walls are detected.
    z = mesh.vertices[mesh.faces, 2] - floor_z_m
    first = np.searchsorted(WALL_HEIGHTS_M, z.min(axis=1))
    last = np.searchsorted(WALL_HEIGHTS_M, z.max(axis=1), side="right")
    upright = mesh.vertices[mesh.faces[last > first]]
    bounds = Rectangles.around(upright[..., :2])
    parts, _ = label(grow(fill))
    regions = []
    for k, window in enumerate(windows(parts), start=1):
        around = grown_window(window, 1, grid.shape)
        selected = fill[around] & (parts[around] == k)
        seam = grow(selected) & reach[around] & ~selected
        local = _sub_grid(around, grid)
        inner = _divide(selected)
        if (seam & wall[around]).any():
            near = upright[bounds.near(local)].reshape(-1, 3)
            heights = floor_z_m + WALL_HEIGHTS_M
            face = slice_marks(near, np.arange(len(near)).reshape(-1, 3), local, heights) > 0
            open_seam = _divide(seam) & ~(face & _divide(wall[around]))
            cross = ndimage.generate_binary_structure(2, 1)
            inner = ndimage.binary_dilation(
                inner, structure=cross, iterations=2 * DIVIDE, mask=inner | open_seam
            )
        else:
            inner = inner | _divide(seam)
        regions.append((inner, local))
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


@dataclass(frozen=True)
class Rectangles:
    """Numbered rectangles along the axes, the bounds of faces from above, sorted by lower x."""

    number: I64
    lower_m: Array
    upper_m: Array
    widest_m: float

    @staticmethod
    def around(corners_m: Array) -> "Rectangles":
        """Return the bounds of polygons (N, n, 2)."""
        lower, upper = corners_m.min(axis=1), corners_m.max(axis=1)
        order = np.argsort(lower[:, 0])
        widest = float((upper - lower)[:, 0].max(initial=0.0))
        return Rectangles(order, lower[order], upper[order], widest)

    def near(self, grid: GridSpec) -> I64:
        """Return the sorted numbers (n,) of rectangles that touch a grid."""
        low = np.asarray(grid.origin_xy_m)
        high = low + np.array([grid.columns, grid.rows]) * grid.cell_m
        first = np.searchsorted(self.lower_m[:, 0], low[0] - self.widest_m)
        last = np.searchsorted(self.lower_m[:, 0], high[0], side="right")
        touches = (self.upper_m[first:last] >= low) & (self.lower_m[first:last] <= high)
        return np.sort(self.number[first:last][touches.all(axis=1)])
