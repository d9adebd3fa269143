"""Floor plans: rooms, doorways, windows, stairs and columns."""

from dataclasses import dataclass

import numpy as np

from ...formats.core.arrays import Array
from .flights import Stairs

# The four sides of a room: (axis the wall is perpendicular to, sign of its outward normal).
SIDES = ((0, -1), (0, 1), (1, -1), (1, 1))


@dataclass(frozen=True)
class Room:
    """A rectangular room.

    Attributes:
        kind: `kitchen`, `living room`, ….
        lower_m, upper_m: (2,) corners of its floor, inside the walls [m].
    """

    kind: str
    lower_m: tuple[float, float]
    upper_m: tuple[float, float]

    @property
    def size_m(self) -> Array:
        """(2,) extent along x and y."""
        return np.asarray(self.upper_m) - np.asarray(self.lower_m)

    @property
    def area_m2(self) -> float:
        """Floor area."""
        return float(np.prod(self.size_m))

    def wall_at(self, axis: int, sign: int) -> float:
        """Return the coordinate along `axis` of the inner face of the wall on that side."""
        return self.upper_m[axis] if sign > 0 else self.lower_m[axis]

    def strip(self, axis: int, sign: int, span_m: tuple[float, float], depth_m: float) -> Array:
        """Return (2, 2) corners of the floor along a stretch of one side [m]."""
        face = self.wall_at(axis, sign)
        rect = np.empty((2, 2))
        rect[:, axis] = sorted((face, face - sign * depth_m))
        rect[:, 1 - axis] = span_m
        return rect

    def span(self, axis: int) -> tuple[float, float]:
        """Return the extent along the wall perpendicular to `axis`."""
        return self.lower_m[1 - axis], self.upper_m[1 - axis]


@dataclass(frozen=True)
class Opening:
    """A hole in one wall of one room: a doorway, a wide passage, a window or the entry door.

    Attributes:
        kind: `door`, `passage` (wider than a door and without a frame), `window` or `entry`.
        room: index of the room.
        axis, sign: the side of the room (see `SIDES`).
        start_m, end_m: extent along the wall.
        bottom_m, top_m: extent in height.
        other_room: for a door or a passage, the room behind it; otherwise −1.
    """

    kind: str
    room: int
    axis: int
    sign: int
    start_m: float
    end_m: float
    bottom_m: float
    top_m: float
    other_room: int = -1


@dataclass(frozen=True)
class Block:
    """A rectangle of a room that holds something other than free floor.

    Attributes:
        kind: `stairs` (the ceiling is open above them), `void` (the floor is open) or `column`.
        room: index of the room.
        lower_m, upper_m: (2,) corners [m].
        top_m: height up to which it is solid, above the storey's floor [m].
        front: for stairs and voids, (axis, sign) of the side from which the stairs rise.
        stairs: of stairs and of the void over them.
    """

    kind: str
    room: int
    lower_m: tuple[float, float]
    upper_m: tuple[float, float]
    top_m: float
    front: tuple[int, int] = (0, 1)
    stairs: Stairs | None = None

    def rect(self) -> Array:
        """Return (2, 2) lower and upper corner [m]."""
        return np.array([self.lower_m, self.upper_m])


@dataclass(frozen=True)
class FloorPlan:
    """Rooms of one storey and the openings in their walls.

    Each doorway appears once per room it joins. Heights count from the storey's own floor.

    Attributes:
        openings: holes in their walls.
        wall_m: thickness of the walls.
        ceiling_m: room height.
        floor_z_m: world height of the floor.
        blocks: stairs, voids and columns.
    """

    rooms: tuple[Room, ...]
    openings: tuple[Opening, ...]
    wall_m: float
    ceiling_m: float
    floor_z_m: float = 0.0
    blocks: tuple[Block, ...] = ()

    def blocks_of(self, room: int, *kinds: str) -> list[Block]:
        """Return the blocks of a room, only those of `kinds` if any are given."""
        return [b for b in self.blocks if b.room == room and (not kinds or b.kind in kinds)]

    def side(self, room: int, axis: int, sign: int) -> list[Opening]:
        """Return the openings on one side of a room."""
        return [o for o in self.openings if o.room == room and o.axis == axis and o.sign == sign]

    def doors_of(self, room: int) -> list[Opening]:
        """Return the doorways and entry door of a room."""
        return [o for o in self.openings if o.room == room and o.kind != "window"]

    @property
    def area_m2(self) -> float:
        """Sum of the rooms' floors."""
        return sum(room.area_m2 for room in self.rooms)

    def bounds(self) -> Array:
        """Return (2, 2) lower and upper corner of all rooms [m]."""
        lower, upper = zip(*((r.lower_m, r.upper_m) for r in self.rooms), strict=True)
        return np.array([np.min(lower, axis=0), np.max(upper, axis=0)])
