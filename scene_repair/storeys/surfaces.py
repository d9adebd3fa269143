"""Connected horizontal surfaces: floors, table tops, beds, stair treads, ceilings."""

import itertools
from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import I32, I64, Array, Mask
from ...formats.process.kernel import called, kernel
from ...formats.scene.grid import GridSpec
from ..grid.columns import Columns

# A walkable surface: at most this steep …
MIN_NORMAL_Z = 0.85
# … and stepping from cell to neighbouring cell by at most this much.
STEP_M = 0.025
# Of surfaces closer together than this (a rug on its floor) only the upper one is seen.
STACK_M = np.float64(0.035)  # compared with heights in float32
# A person stands where this much is free above.
STANDING_M = 1.6


@dataclass(frozen=True)
class Surfaces:
    """Connected horizontal surfaces: samples (N,) with their cells, heights and triangles.

    `clear_m` is the free height above, inf under the open sky; `part` is 0 … parts − 1.
    """

    cell: I64
    z_m: Array
    face: I32
    clear_m: Array
    part: I64
    parts: int


def find_surfaces(columns: Columns, normal_z: Array, ignore: Mask, clear_m: float) -> Surfaces:
    """Group the horizontal samples with at least `clear_m` of free height above into surfaces.

    `normal_z` (F,) are vertical parts of unit normals, whose sign is not used: a scan's winding
    cannot be trusted. `ignore` (F,) are faces that are no floor, whatever their shape.
    """
    cell, z, face = columns.cell, columns.z.astype(np.float64), columns.face
    level = (np.abs(normal_z) >= MIN_NORMAL_Z)[face] & ~ignore[face]
    clear = _clearance(columns, STACK_M)
    hidden = _hidden(columns, np.ones(len(z), dtype=np.bool_), STACK_M)
    # A ceiling in the plane of the floor above it, as storeys stacked by an exporter have, does not
    # hide that floor; the underside of a box does, because there is no room to stand in it.
    ceiled = hidden & (clear >= STANDING_M) & ~_hidden(columns, level, STACK_M)
    index = np.flatnonzero(level & (~hidden | ceiled) & (clear >= clear_m))
    part = connected(cell[index], z[index], columns.grid, STEP_M)
    count = int(part.max()) + 1 if len(part) else 0
    return Surfaces(cell[index], z[index], face[index], clear[index], part, count)


def connected(cell: I64, z_m: Array, grid: GridSpec, step_m: float) -> I64:
    """Return the number, from 0, of the connected part that each sample (N,) belongs to.

    `cell` (N,) is sorted; samples of neighbouring cells are connected if their heights differ by at
    most `step_m`.
    """
    start = np.searchsorted(cell, np.arange(grid.rows * grid.columns + 1))
    own = np.arange(len(z_m))
    parent = own.copy()
    _connect(start, z_m, (grid.rows, grid.columns), step_m, parent)
    return (np.cumsum(parent == own) - 1)[parent]


def _clearance(columns: Columns, stack: np.float64) -> Array:
    """Return the free height above every sample up to the next one outside its own stack."""
    z, end = columns.z, columns.start[1:][columns.cell]
    clear, below = np.full(len(z), np.inf), np.arange(len(z))
    for above in itertools.count(1):
        below = below[below + above < end[below]]
        if not len(below):
            break
        gap = z[below + above] - z[below]
        free = gap >= stack
        clear[below[free]] = gap[free]
        below = below[~free]
    return clear


def _hidden(columns: Columns, marked: Mask, stack: np.float64) -> Mask:
    """Return which samples have a marked one just above them."""
    z, end = columns.z, columns.start[1:][columns.cell]
    hidden, below = np.zeros(len(z), dtype=bool), np.arange(len(z))
    for above in itertools.count(1):
        below = below[below + above < end[below]]
        below = below[z[below + above] - z[below] < stack]
        if not len(below):
            break
        hidden[below] |= marked[below + above]
    return hidden


@called()
def _root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@kernel()
def _connect(start, z, shape, step, parent):
    """Connect samples in neighbouring cells whose heights differ by at most `step`."""
    rows, columns = shape
    for i in range(rows):
        for j in range(columns):
            cell = i * columns + j
            for side in range(2):
                if side == 0 and j + 1 < columns:
                    other = cell + 1
                elif side == 1 and i + 1 < rows:
                    other = cell + columns
                else:
                    continue
                for k in range(start[cell], start[cell + 1]):
                    for m in range(start[other], start[other + 1]):
                        if abs(z[k] - z[m]) <= step:
                            a, b = _root(parent, k), _root(parent, m)
                            if a != b:
                                parent[max(a, b)] = min(a, b)
    for k in range(len(z)):
        parent[k] = _root(parent, k)
