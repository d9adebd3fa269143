"""Open slabs that run on over flights: a storey's floor, drawn without the hole for its stairs.

A flight that ends on a floor under that very floor is a fault of the model: nobody could arrive. A
ceiling that is merely low hangs elsewhere, and a gallery leaves the head of the flight open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from ...formats.core.arrays import I64, Array, Mask
from ...formats.core.frames import in_plan_frame
from ...formats.scene import FULL_HEIGHT_M
from ...formats.scene.grid import GridSpec
from ...formats.scene.staircase import Treads
from ..grid.columns import Columns, sample_columns
from ..grid.slices import slice_marks
from ..grid.world_mesh import WorldMesh
from ..scan.record import Scan
from .floor_parts import UPRIGHT_NORMAL_Z
from .levels import ScannedFloor
from .staircases import find_staircases
from .surfaces import STACK_M, Surfaces, find_surfaces
from .treads import TREAD_STEP_M

# A slab is at most so thick, and the upper face of its floor differs from the level by no more.
_THICK_M, _LEVEL_M = 0.5, 0.04
_FLAT_NORMAL_Z = 0.98
# Treads and landings are no larger; what is nearer to one than this is the same surface.
_LANDING_M2, _SAME_M = 4.0, 0.01
_CLEAR_M = 0.08
# So much of the last tread lies under it, and at most so much of the flight under anything else;
# a wall across a tread takes more of it than the last.
_CLOSED_SHARE, _OTHER_SHARE, _WALL_SHARE = 0.75, 0.05, 0.1
# What stands beside a flight may reach this far over its treads.
_BESIDE_M = 0.1
# Treads end with their nosings no further than this from their boxes.
_NOSING_M = 0.06
_CELL_M = 0.05
# Cuts reach so far over each other that no sliver stays between them.
_OVERLAP_M = 0.002
# Walls and things on the slab are looked for this far above it.
_ABOVE_M = np.array([0.1, 0.4, 0.8, 1.2, 1.6])


@dataclass(frozen=True)
class Slab:
    """What is taken out of a slab over a staircase.

    Attributes:
        levels: that the staircase joins.
        level_m: height of the upper one.
        treads: all treads and landings of the staircase.
        openings: those over which it is taken out.
    """

    levels: tuple[int, int]
    level_m: float
    treads: Treads
    openings: Treads

    @property
    def area_m2(self) -> float:
        """Area of the openings, seen from above."""
        return float(4.0 * self.openings.half_m[:, :2].prod(axis=1).sum())

    @property
    def middle_xy_m(self) -> Array:
        """(2,) middle of the openings."""
        return self.openings.center_m[:, :2].mean(axis=0)


def slabs_over(columns: Columns, floors: Sequence[ScannedFloor], mesh: WorldMesh) -> list[Slab]:
    """Return the slabs that hang over complete flights, where nothing else does.

    Stairs are looked for as if those slabs were not there.
    """
    normal_z, ignore = mesh.normals[:, 2], np.zeros(len(mesh.faces), dtype=bool)
    bare = _bare(columns, floors, find_surfaces(columns, normal_z, ignore, STACK_M))
    surfaces = find_surfaces(bare, normal_z, ignore, _CLEAR_M)
    slabs = [
        _slab_over(scanned.staircase.levels, scanned.treads, mesh)
        for scanned in find_staircases(surfaces, list(floors))
        if scanned.treads is not None
    ]
    return [slab for slab in slabs if slab is not None]


def _bare(columns: Columns, floors: Sequence[ScannedFloor], surfaces: Surfaces) -> Columns:
    """Return the hits without those of slabs over what is as small as a tread or landing."""
    large = np.bincount(surfaces.part, minlength=surfaces.parts) * columns.grid.cell_m**2
    small = large[surfaces.part] < _LANDING_M2
    cells = len(columns.start) - 1
    cell, kept = columns.cell, np.ones(len(columns.z), dtype=bool)
    for lower, upper in pairwise(floors):
        between = (surfaces.z_m > lower.floor_z_m + _LEVEL_M) & small
        between &= surfaces.z_m < upper.floor_z_m - _LEVEL_M
        over = np.bincount(surfaces.cell[between], minlength=cells) > 0
        slab = over[cell] & (columns.z > upper.floor_z_m - _THICK_M)
        slab &= columns.z < upper.floor_z_m + _LEVEL_M
        z = np.full(cells, -np.inf)
        np.maximum.at(z, surfaces.cell[between], surfaces.z_m[between])
        kept &= ~(slab & (columns.z > z[cell] + _SAME_M))
    start = np.concatenate([[0], np.cumsum(np.bincount(cell[kept], minlength=cells))])
    return Columns(columns.grid, start, columns.z[kept], columns.face[kept])


def _slab_over(levels: tuple[int, int], boxes: Treads, mesh: WorldMesh) -> Slab | None:
    """Return the slab that shuts stairs with these boxes; None if something else is there."""
    treads, level_m = boxes.without_edge, float(boxes.top_m[-1])
    low_m, high_m = level_m - _THICK_M, level_m + _LEVEL_M
    corners = mesh.vertices[mesh.faces]
    reach = float(np.linalg.norm(treads.half_m[:, :2], axis=1).max())
    ends = treads.center_m[:, :2].min(axis=0) - reach, treads.center_m[:, :2].max(axis=0) + reach
    near = np.all(corners[..., :2].max(axis=1) > ends[0], axis=1)
    near &= np.all(corners[..., :2].min(axis=1) < ends[1], axis=1)
    faces, normal_z = mesh.faces[near], np.abs(mesh.normals[near, 2])
    grid = GridSpec.covering(*ends, _CELL_M)
    columns = sample_columns(mesh.vertices, faces, grid)
    xy = grid.center_of(np.moveaxis(np.indices(grid.shape), 0, -1)).reshape(-1, 2)
    inner = replace(treads, half_m=np.maximum(treads.half_m - (0.0, _BESIDE_M, 0.0), 0.01))
    tread = np.full(len(xy), -1)
    for k, holds in enumerate(inner.holds(xy)):
        tread[holds] = k
    top_m = np.where(tread >= 0, treads.top_m[tread], np.inf)
    over = columns.z - top_m[columns.cell]
    hanging = (over > TREAD_STEP_M) & (over < FULL_HEIGHT_M)
    in_slab = (columns.z > low_m) & (columns.z < high_m) & (normal_z[columns.face] > _FLAT_NORMAL_Z)

    def cells(hits: Mask) -> Mask:
        return np.bincount(columns.cell[hits], minlength=len(xy)) > 0

    closed = cells(hanging & in_slab)
    upright = faces[normal_z < UPRIGHT_NORMAL_Z]
    marks = slice_marks(mesh.vertices, upright, grid, level_m + _ABOVE_M).ravel()
    stands = np.zeros(len(xy), dtype=bool)
    for n, height in enumerate(level_m + _ABOVE_M):
        stands |= (marks >> n & 1).astype(bool) & (height < top_m + FULL_HEIGHT_M)
    own = [tread == k for k in range(len(treads.yaw_rad))]
    other = cells(hanging & ~in_slab)[tread >= 0].mean()
    if closed[own[-1]].mean() < _CLOSED_SHARE or other > _OTHER_SHARE:
        return None
    if max(stands[cells_of].mean() for cells_of in own) > _WALL_SHARE:
        return None
    shut = np.flatnonzero(treads.top_m + FULL_HEIGHT_M > level_m - _THICK_M)
    shut = shut[[bool(closed[tread == k].any()) for k in shut]]
    return Slab(levels, level_m, treads, _chosen(treads, shut))


def _chosen(treads: Treads, numbers: I64) -> Treads:
    return Treads(treads.center_m[numbers], treads.half_m[numbers], treads.yaw_rad[numbers])


def with_opened(scan: Scan, source_to_world: Array, slabs: Sequence[Slab]) -> Scan:
    """Return the scan without the level faces of slabs over flights; faces are cut at the rim."""
    for slab in slabs:
        mesh = WorldMesh.of(scan, source_to_world)
        z = mesh.vertices[:, 2][mesh.faces]
        level = np.abs(mesh.normals[:, 2]) > _FLAT_NORMAL_Z
        level &= np.all((z > slab.level_m - _THICK_M) & (z < slab.level_m + _LEVEL_M), axis=1)
        flat = np.flatnonzero(level)
        level[flat[_of_treads(mesh.vertices[mesh.faces[flat]], slab.treads)]] = False
        cut = scan.take_faces(level)
        for number in range(len(slab.openings.yaw_rad)):
            cut = _cut(cut, source_to_world, _chosen(slab.openings, np.array([number])))
        scan = _joined(replace(scan.take_faces(~level), vertices=cut.vertices), cut)
    return scan


def with_levels_of(
    slabs: Sequence[Slab], before: Sequence[ScannedFloor], after: Sequence[ScannedFloor]
) -> list[Slab]:
    """Return the slabs, found with floors `before`, with the levels of the same height `after`."""
    height_m = np.array([floor.floor_z_m for floor in after])

    def level(number: int) -> int:
        return int(np.abs(height_m - before[number].floor_z_m).argmin())

    return [replace(slab, levels=(level(slab.levels[0]), level(slab.levels[1]))) for slab in slabs]


def _of_treads(corners: Array, treads: Treads) -> Mask:
    """Return which level faces (F, 3 corners, 3) belong to a tread; nosings hang over the next."""
    high = np.abs(corners[..., 2] - treads.top_m[:, None, None]) < TREAD_STEP_M
    return np.any(np.all(treads.holds(corners[..., :2], _NOSING_M) & high, axis=-1), axis=0)


def _joined(scan: Scan, more: Scan) -> Scan:
    """Return a scan with the faces of another one of the same vertices."""
    names = ("faces", "corner_uv", "face_material", "face_object", "face_part")
    changes: dict[str, Any] = {
        name: np.concatenate([getattr(scan, name), getattr(more, name)]) for name in names
    }
    return replace(scan, **changes)


def _cut(scan: Scan, source_to_world: Array, box: Treads) -> Scan:
    """Return level faces without what lies over one box."""
    mesh = WorldMesh.of(scan, source_to_world)
    half, yaw = box.half_m[0, :2] + _OVERLAP_M, float(box.yaw_rad[0])
    own = in_plan_frame(mesh.vertices[:, :2], box.center_m[0, :2], yaw)[mesh.faces]
    inside = mesh.vertices[mesh.faces, 2].min(axis=1) > box.top_m[0] + TREAD_STEP_M
    inside &= np.all((own.max(axis=1) > -half) & (own.min(axis=1) < half), axis=1)
    touched = np.flatnonzero(inside)
    # Corners of pieces: place in the rectangle's frame, position in the source, texture.
    corner_uv = scan.corner_uv.astype(np.float64)
    table = np.concatenate([own, scan.vertices[scan.faces], corner_uv], axis=2)
    pieces, parents = [], []
    for face in touched:
        for piece in _outside(table[face], half):
            fan = [[piece[0], piece[k], piece[k + 1]] for k in range(1, len(piece) - 1)]
            pieces += fan
            parents += [face] * len(fan)
    kept = scan.take_faces(~inside)
    if not pieces:
        return kept
    corners, parent = np.array(pieces), np.array(parents)
    first = len(scan.vertices)
    cut = replace(
        scan,
        vertices=np.concatenate([scan.vertices, corners[..., 2:5].reshape(-1, 3)]),
        faces=first + np.arange(3 * len(corners)).reshape(-1, 3),
        corner_uv=corners[..., 5:].astype(np.float32),
        face_material=scan.face_material[parent],
        face_object=scan.face_object[parent],
        face_part=scan.face_part[parent],
    )
    return _joined(replace(kept, vertices=cut.vertices), cut)


def _outside(polygon: Array, half: Array) -> list[Array]:
    """Return the convex parts (n, values) of a polygon outside of a rectangle around the origin.

    The first two values of a corner are its coordinates.
    """
    parts = []
    for axis in (0, 1):
        for sign in (-1.0, 1.0):
            parts.append(_clipped(polygon, axis, sign, half[axis], beyond=True))
            polygon = _clipped(polygon, axis, sign, half[axis], beyond=False)
    return [part for part in parts if len(part) >= 3]


def _clipped(polygon: Array, axis: int, sign: float, limit: float, *, beyond: bool) -> Array:
    """Return the part of a convex polygon on one side of a line (Sutherland and Hodgman)."""
    if not len(polygon):
        return polygon
    over = (sign * polygon[:, axis] - limit) * (1.0 if beyond else -1.0)
    corners = []
    for k in range(len(polygon)):
        n = (k + 1) % len(polygon)
        if over[k] >= 0:
            corners.append(polygon[k])
        if over[k] * over[n] < 0:
            share = over[k] / (over[k] - over[n])
            corners.append(polygon[k] + share * (polygon[n] - polygon[k]))
    return np.array(corners) if np.max(over) > 0 else polygon[:0]
