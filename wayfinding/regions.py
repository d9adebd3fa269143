"""Segment a level into rooms: by room labels if there are any, else by the walls.

The sampler prefers paths that pass between rooms, and the instructions name the rooms.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import distance_transform_edt, find_objects
from skimage.measure import label
from skimage.morphology import local_maxima, reconstruction, remove_small_holes
from skimage.segmentation import watershed

from ..formats.core.arrays import I32, Array, Mask
from ..formats.scene.bundle import LabeledObject, SceneBundle
from ..formats.scene.grid import GridSpec

ROOM_PREFIX = "room:"

# A thing that fills all of these heights above the floor is a wall, a door or a cupboard: tables
# and sofas end below, lamps hang above. Things smaller than a wall's end (a vase) are dropped.
_SLICES_M = ((0.5, 0.9), (0.95, 1.3), (1.35, 1.65))
_MIN_WALL_M = 0.7
_EDGE = 0.05  # of a cell
# A bottleneck splits a space when it is this much narrower than the smaller side's widest place.
_NECK_RATIO = 0.88
_MIN_ROOM_M2 = 2.5
# Space farther than this from any labelled room (a doorway's depth) belongs to none.
_REACH_M = 1.0

# Things by which a room without a label is named. They also distinguish the rooms
# of one open space.
_OBJECTS_OF_ROOM = {
    "bedroom": ("bed", "nightstand"),
    "living room": ("sofa", "couch", "coffee table", "tv cabinet"),
    "kitchen": (
        *("refrigerator", "fridge", "stove", "oven", "kitchen cabinet", "kitchen counter"),
        *("kitchen table", "cooking bench"),
    ),
    "dining room": ("dining table",),
    "bathroom": ("toilet", "bathtub", "shower"),
    "exercise room": ("fitness equipment", "treadmill"),
    "laundry room": ("washing machine",),
    "music room": ("piano",),
}
ROOM_OF_OBJECT = {thing: room for room, things in _OBJECTS_OF_ROOM.items() for thing in things}


@dataclass(frozen=True)
class RegionMap:
    """The rooms of a level by cell.

    Attributes:
        region: (rows, columns) int32 index into `names`, −1 = outside of every room.
        names: what each room is called (`kitchen`), or "" if unknown.
        width_m: (rows, columns) float64 [m]: twice the distance to the nearest wall, i.e. the
            width of the passage where the cell lies in the middle of one.
    """

    grid: GridSpec
    region: I32
    names: tuple[str, ...]
    width_m: Array

    def at(self, xy_m: ArrayLike) -> I32:
        """Return room indices (...) at points (..., 2) [m]; −1 outside."""
        inside, cells = self.grid.inside(self.grid.cell_of(xy_m)), self.grid.clamped_cell_of(xy_m)
        return np.where(inside, self.region[cells[..., 0], cells[..., 1]], -1).astype(np.int32)

    def name_at(self, xy_m: ArrayLike) -> str:
        """Return the name of the room at a point (2,) [m]; "" if unknown."""
        index = int(self.at(xy_m))
        return self.names[index] if index >= 0 else ""


def region_map(bundle: SceneBundle, level: int) -> RegionMap:
    """Find the rooms of a level.

    Objects of category `room:<kind>` are believed when the level has any (the smallest box that
    contains a cell wins). Otherwise the floor between the walls is split at its bottlenecks, and
    named, and split further where it is one open space, by what stands in it.
    """
    floor = bundle.floor(level)
    grid = floor.grid
    # A hole in the floor is a flaw of the scan, no wall.
    hole_cells = int(_MIN_ROOM_M2 / grid.cell_m**2)
    covered = remove_small_holes(floor.covered, max_size=hole_cells)
    open_floor = covered & ~_walls(bundle, level, grid)
    here = [o for o in bundle.objects if o.level in (level, -1)]
    return split_rooms(open_floor, here, grid)


def split_rooms(open_floor: Mask, objects: Sequence[LabeledObject], grid: GridSpec) -> RegionMap:
    """Split the floor between walls, (rows, columns), into rooms; see `region_map`."""
    width = 2.0 * np.asarray(distance_transform_edt(np.pad(open_floor, 1)))[1:-1, 1:-1]
    width = np.maximum(width - 1.0, 0.0) * grid.cell_m
    rooms = [o for o in objects if o.category.startswith(ROOM_PREFIX)]
    if rooms:
        region, names = _labelled(rooms, grid), tuple(o.category[len(ROOM_PREFIX) :] for o in rooms)
    else:
        region, names = _furnished(_necks(width, open_floor, grid.cell_m), width, objects, grid)
    return RegionMap(grid, _extend(region, open_floor, grid.cell_m), names, width)


def _walls(bundle: SceneBundle, level: int, grid: GridSpec) -> Mask:
    """Return cells (rows, columns) of walls, doors and tall cupboards; see `_SLICES_M`."""
    boxes = bundle.obstacles(level)
    z = bundle.level_floor_z_m[level]
    lower, upper = boxes.center_m - boxes.half_m, boxes.center_m + boxes.half_m
    result = np.ones(grid.shape, dtype=bool)
    for bottom, top in _SLICES_M:
        filled = np.zeros(grid.shape, dtype=bool)
        hit = (upper[:, 2] > z + bottom) & (lower[:, 2] < z + top)
        for low, high in zip(lower[hit, :2], upper[hit, :2], strict=True):
            _box(filled, grid, low, high)[...] = True
        result &= filled
    parts = np.asarray(label(result, connectivity=2))
    for k, (rows, columns) in enumerate(find_objects(parts), start=1):
        size = np.hypot(rows.stop - rows.start, columns.stop - columns.start) * grid.cell_m
        if size < _MIN_WALL_M:
            result[rows, columns][parts[rows, columns] == k] = False
    return result


def _box(array: NDArray, grid: GridSpec, low: ArrayLike, high: ArrayLike) -> NDArray:
    """Return a view of the cells of `array` that a box `low` … `high` (2,), (2,) [m] touches."""
    shape = np.array(grid.shape)
    # A box that ends on a cell's edge does not touch the next cell, whatever the rounding says.
    low, high = (grid.fractional_cell_of(np.asarray(corner)[:2]) for corner in (low, high))
    first = np.clip(np.floor(low + 0.5 + _EDGE), 0, shape).astype(int)
    stop = np.clip(np.ceil(high + 0.5 - _EDGE), 0, shape).astype(int)
    return array[first[0] : max(stop[0], first[0]), first[1] : max(stop[1], first[1])]


def _labelled(rooms: Sequence[LabeledObject], grid: GridSpec) -> I32:
    region = np.full(grid.shape, -1, dtype=np.int32)
    area = [np.prod(np.subtract(o.upper_m, o.lower_m)[:2]) for o in rooms]
    for k in np.argsort(area)[::-1]:
        _box(region, grid, rooms[k].lower_m, rooms[k].upper_m)[...] = k
    return region


def _necks(width: Array, open_floor: Mask, cell_m: float) -> I32:
    """Split the free floor at bottlenecks: watershed of the width from its significant maxima.

    A maximum is significant when every way to a higher one narrows below `_NECK_RATIO` of it
    (morphological reconstruction; Soille, "Morphological Image Analysis", 2003, ch. 6).
    """
    flooded = reconstruction(width * _NECK_RATIO, width, method="dilation")
    peaks = label(local_maxima(flooded) & open_floor, connectivity=2)
    parts = watershed(-width, peaks, mask=open_floor)
    sizes = np.bincount(parts.ravel(), minlength=1) * cell_m**2
    large = np.flatnonzero(sizes >= _MIN_ROOM_M2)
    large = large[large > 0]
    # Nooks too small to be rooms join the room they open to.
    lookup = np.zeros(len(sizes), dtype=np.int32)
    lookup[large] = np.arange(1, len(large) + 1)
    merged = watershed(np.zeros_like(parts), lookup[parts], mask=open_floor)
    return (merged - 1).astype(np.int32)


def _furnished(
    region: I32, width: Array, objects: Sequence[LabeledObject], grid: GridSpec
) -> tuple[I32, tuple[str, ...]]:
    """Name regions by their furniture; split those with the furniture of several rooms."""
    result = np.full_like(region, -1)
    names: list[str] = []
    for k in range(int(region.max(initial=-1)) + 1):
        mask = region == k
        markers = np.zeros(region.shape, dtype=np.int32)
        kinds: list[str] = []
        for thing in objects:
            kind = ROOM_OF_OBJECT.get(thing.category)
            if kind is None:
                continue
            low, high = np.array(thing.lower_m[:2]) - 0.2, np.array(thing.upper_m[:2]) + 0.2
            inside = _box(mask, grid, low, high)
            if inside.mean() < 0.4 if inside.size else True:
                continue
            if kind not in kinds:
                kinds.append(kind)
            _box(markers, grid, low, high)[inside] = kinds.index(kind) + 1
        if len(kinds) < 2:
            result[mask] = len(names)
            names.append(kinds[0] if kinds else "")
            continue
        parts = watershed(np.zeros_like(width), markers, mask=mask)
        for j, kind in enumerate(kinds, start=1):
            result[parts == j] = len(names)
            names.append(kind)
        result[mask & (parts == 0)] = len(names) - 1
    return result, tuple(names)


def _extend(region: I32, open_floor: Mask, cell_m: float) -> I32:
    """Assign unclaimed floor (a doorway's depth) to the nearest room within reach."""
    index = distance_transform_edt(region < 0, return_distances=False, return_indices=True)
    nearest = region[tuple(np.asarray(index))]
    reach = np.asarray(distance_transform_edt(region < 0)) * cell_m <= _REACH_M
    return np.where((region < 0) & open_floor & reach, nearest, region).astype(np.int32)
