"""Placement of furniture in a room, so that doors stay clear and robots can pass."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt, label

from ...formats.core.arrays import Array, Mask
from .furniture.piece import Arrangement, Piece
from .plan import SIDES, FloorPlan, Opening
from .stairs import floor_at_ends, occupied_floor

Rect = Array

_CELL_M = 0.05
_DOOR_DEPTH_M, _DOOR_SIDE_M = 0.9, 0.12
_WALL_GAP_M = 0.02
# Stairs that are nearer to a wall rise from behind its opening.
_NEAR_M = 0.3


def wall_yaw(axis: int, sign: int) -> float:
    """Return the yaw [rad] that turns a piece's back (−y) to the wall on that side."""
    return {(0, 1): 0.5 * np.pi, (0, -1): -0.5 * np.pi, (1, 1): np.pi, (1, -1): 0.0}[axis, sign]


def overlaps(a: Rect, b: Rect, gap_m: float = 0.0) -> bool:
    """Return whether two (2, 2) rectangles come nearer than `gap_m`."""
    return bool(np.all(a[0] < b[1] + gap_m) and np.all(b[0] < a[1] + gap_m))


class RoomSpace:
    """One room being furnished."""

    def __init__(self, plan: FloorPlan, index: int, radius_m: float):
        self.plan, self.index, self.room = plan, index, plan.rooms[index]
        self.radius_m = radius_m
        self.bounds = np.array([self.room.lower_m, self.room.upper_m])
        self.solids: list[Rect] = []
        self.reserved: list[Rect] = []
        self.entrances: list[Array] = []
        self.tops: list[tuple[Rect, float]] = []
        self.blocks = [occupied_floor(block) for block in plan.blocks_of(index)]
        for rect, block in zip(self.blocks, plan.blocks_of(index), strict=True):
            self.solids.append(rect)
            self.tops.append((rect, block.top_m))
        for door in plan.doors_of(index):
            self._keep_door(door)
        for block in plan.blocks_of(index, "stairs", "void"):
            self._keep_stairs(floor_at_ends(block))

    def _keep_door(self, door: Opening) -> None:
        axis, sign, start, end = door.axis, door.sign, door.start_m, door.end_m
        face = self.room.wall_at(axis, sign)
        depth = min(_DOOR_DEPTH_M, 0.8 * float(self.room.size_m[axis]))
        sides = (start - _DOOR_SIDE_M, end + _DOOR_SIDE_M)
        self.reserved.append(self.room.strip(axis, sign, sides, depth))
        point = np.empty(2)
        point[axis], point[1 - axis] = face - sign * 0.45, (start + end) / 2
        near = [abs(b[int(sign > 0), axis] - face) < _NEAR_M for b in self.blocks]
        if any(near) and door.kind == "passage" and self.room.kind == "stairwell":
            # Beside the stairs, whose foot lies in the passage too.
            sides = ((start, self.blocks[0][0, 1 - axis]), (self.blocks[0][1, 1 - axis], end))
            point[1 - axis] = np.mean(max(sides, key=lambda side: side[1] - side[0]))
        self.entrances.append(point)

    def _keep_stairs(self, floor: Rect) -> None:
        """Keep the floor before the stairs' foot or behind their head, if it is in this room."""
        inside = np.clip(floor, *self.bounds)
        if (inside[1] - inside[0]).min() > _NEAR_M:
            self.reserved.append(inside)
            self.entrances.append(inside.mean(0))

    def fits(self, item: Arrangement) -> bool:
        """Return whether `item`, in place, respects walls, doors, windows and other furniture."""
        bounds = item.bounds()
        flat = bounds[:, :2]
        if np.any(flat[0] < self.bounds[0]) or np.any(flat[1] > self.bounds[1]):
            return False
        solids = item.footprints()
        for solid in solids:
            if any(overlaps(solid, zone) for zone in self.reserved):
                return False
            if any(overlaps(solid, other, 0.06) for other in self.solids):
                return False
        boxes = [] if item.on_window else [piece.shape.bounds() for piece in item.pieces]
        if any(self._hides_window(box[:, :2], float(box[1, 2])) for box in boxes):
            return False
        return self.passable(solids)

    def _hides_window(self, flat: Rect, top_m: float) -> bool:
        for axis, sign in SIDES:
            near = abs(flat[int(sign > 0), axis] - self.room.wall_at(axis, sign)) < 0.25
            for hole in self.plan.side(self.index, axis, sign):
                inside = flat[0, 1 - axis] < hole.end_m and flat[1, 1 - axis] > hole.start_m
                if hole.kind == "window" and near and inside and top_m > hole.bottom_m + 0.05:
                    return True
        return False

    def place(self, item: Arrangement) -> None:
        """Take the space of `item`, already in place."""
        self.solids += item.footprints()
        for piece in item.pieces:
            bounds = piece.shape.bounds()
            self.tops.append((bounds[:, :2], float(bounds[1, 2])))

    def free_cells(self, more: list[Rect]) -> tuple[Mask, Array]:
        """Return the cells where a robot fits beside `more` furniture, and the grid's origin."""
        shape = np.ceil((self.bounds[1] - self.bounds[0]) / _CELL_M).astype(int) + 2
        blocked = np.ones(shape, dtype=bool)
        blocked[1:-1, 1:-1] = False
        origin = self.bounds[0] - _CELL_M
        for solid in [*self.solids, *more]:
            low = np.floor((solid[0] - origin) / _CELL_M).astype(int)
            high = np.ceil((solid[1] - origin) / _CELL_M).astype(int)
            low, high = np.maximum(low, 0), np.maximum(high, 0)
            blocked[low[0] : high[0], low[1] : high[1]] = True
        distance = np.asarray(distance_transform_edt(~blocked)) - 0.5
        return distance * _CELL_M >= self.radius_m, origin

    def passable(self, more: list[Rect]) -> bool:
        """Return whether all doors stay joined and a good part of the room can be walked."""
        free, origin = self.free_cells(more)
        groups = np.zeros(free.shape, dtype=np.int32)
        label(free, output=groups)
        cells = [tuple(((point - origin) / _CELL_M).astype(int)) for point in self.entrances]
        ids = {int(groups[cell]) for cell in cells}
        if 0 in ids or len(ids) > 1:
            return False
        reached = np.count_nonzero(groups == ids.pop()) * _CELL_M**2
        # A narrow corridor leaves little room for the centre of a disc even when it is empty.
        narrow = max(float(self.room.size_m.min()) - 2 * self.radius_m, 0.1)
        return reached >= 0.25 * narrow * (float(self.room.size_m.max()) - 2 * self.radius_m)


class WallPlace(NamedTuple):
    """Furniture in its place at a wall: side, distance along it [m], and the pieces."""

    axis: int
    sign: int
    along_m: float
    item: Arrangement


def at_wall(
    space: RoomSpace, item: Arrangement, axis: int, sign: int, along_m: float
) -> Arrangement:
    """Return `item` with its back to a wall and its x = 0 at `along_m`."""
    xy = np.empty(2)
    xy[axis] = space.room.wall_at(axis, sign) - sign * _WALL_GAP_M
    xy[1 - axis] = along_m
    return item.moved(wall_yaw(axis, sign), float(xy[0]), float(xy[1]))


def front_zone(space: RoomSpace, placed: Arrangement, axis: int, sign: int) -> Rect:
    """Return the rectangle that must stay free before an arrangement at a wall."""
    flat = placed.bounds()[:, :2].copy()
    if sign > 0:
        flat[1, axis] = flat[0, axis]
        flat[0, axis] -= placed.front_m
    else:
        flat[0, axis] = flat[1, axis]
        flat[1, axis] += placed.front_m
    return flat


def try_wall(
    space: RoomSpace,
    rng: np.random.Generator,
    item: Arrangement,
    sides: list[tuple[int, int]] | None = None,
    along_m: float | None = None,
    tries: int = 14,
) -> WallPlace | None:
    """Place `item` at some wall, or return None if it fits nowhere.

    Corners and the stretch near `along_m` are tried first.
    """
    low_x, high_x = item.bounds()[:, 0]
    options: list[tuple[int, int, float]] = []
    for axis, sign in sides or SIDES:
        start, end = space.room.span(axis)
        # The direction of local x along the wall decides where its extent may lie.
        before, after = (high_x, -low_x) if _mirrored(axis, sign) else (-low_x, high_x)
        first, last = start + before + 0.02, end - after - 0.02
        if first > last:
            continue
        middle = [along_m] if along_m is not None else []
        for s in [*middle, first, last, *rng.uniform(first, last, 4)]:
            options.append((axis, sign, float(np.clip(s, first, last))))
    if along_m is None:
        options = [options[k] for k in rng.permutation(len(options))]
    for axis, sign, along in options[: tries * 2]:
        placed = at_wall(space, item, axis, sign, along)
        zone = front_zone(space, placed, axis, sign)
        if any(overlaps(zone, solid) for solid in space.solids):
            continue
        if space.fits(placed):
            space.place(placed)
            space.reserved.append(zone)
            return WallPlace(axis, sign, along, placed)
    return None


def put_at_walls(
    space: RoomSpace, rng: np.random.Generator, items: Iterable[Arrangement]
) -> list[Piece]:
    """Place at walls those of `items` that fit, in order, and return their pieces."""
    places = [try_wall(space, rng, item) for item in items]
    return [piece for place in places if place for piece in place.item.pieces]


def first_at_wall(
    space: RoomSpace, rng: np.random.Generator, items: Iterable[Arrangement]
) -> list[Piece]:
    """Place at a wall the first of `items` that fits, and return its pieces; none if none fits."""
    places = (try_wall(space, rng, item, tries=20) for item in items)
    return next((list(place.item.pieces) for place in places if place), [])


def first_in_middle(
    space: RoomSpace, rng: np.random.Generator, items: Iterable[Arrangement], tries: int
) -> list[Piece]:
    """Place free in the room the first of `items` that fits, and return its pieces."""
    places = (try_middle(space, rng, item, tries) for item in items)
    return next((list(place.pieces) for place in places if place), [])


def _mirrored(axis: int, sign: int) -> bool:
    """Return whether a piece's +x runs against the wall's coordinate."""
    yaw = wall_yaw(axis, sign)
    return bool((np.cos(yaw), np.sin(yaw))[1 - axis] < 0)


def try_middle(
    space: RoomSpace, rng: np.random.Generator, item: Arrangement, tries: int
) -> Arrangement | None:
    """Place `item` free in the room, near its centre first; None if it fits nowhere."""
    for k in range(tries):
        turned = item.moved(0.5 * np.pi * int(rng.integers(2)), 0.0, 0.0)
        spread = 0.08 + 0.5 * k / tries
        center = space.bounds.mean(0) + rng.uniform(-0.5, 0.5, 2) * spread * space.room.size_m
        placed = turned.moved(0.0, float(center[0]), float(center[1]))
        if space.fits(placed):
            space.place(placed)
            return placed
    return None
