"""A staircase with two flights and a landing, the stairwell above it and its railings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...formats.core.arrays import Array
from .furniture.piece import Piece
from .plan import SIDES, Block, Room
from .shapes import Triangles, box, join, quad, rod

_WIDTH_M, _SPINE_M = 2.0, 0.1
_TREAD_M, _RISER_M = 0.26, 0.175
# The first riser and the upper storey's railing stand this far behind the opening to the corridor.
_SETBACK_M = 0.15
_NOSING_M, _TREAD_THICK_M = 0.02, 0.035
_RAIL_M, _RAIL_DEPTH_M = 0.95, 0.06


def stairs_block(rooms: Sequence[Room], wall_m: float, rise_m: float) -> Block:
    """Return the stairs in the stairwell among the lower storey's `rooms`, `rise_m` high.

    They run along a side wall of the stairwell, from the hallway before it.
    """
    index = next(k for k, room in enumerate(rooms) if room.kind == "stairwell")
    room, hall = rooms[index], next(r for r in rooms if r.kind == "hallway")
    axis, sign = next(
        (a, s)
        for a, s in SIDES
        if abs(hall.wall_at(a, -s) - room.wall_at(a, s) - s * wall_m) < 1e-6
    )
    rect = np.array([room.lower_m, room.upper_m])
    rect[int(sign > 0), axis] -= sign * _SETBACK_M
    rect[1, 1 - axis] = rect[0, 1 - axis] + _WIDTH_M
    low, high = rect.tolist()
    return Block("stairs", index, (low[0], low[1]), (high[0], high[1]), rise_m, front=(axis, sign))


def upper_void(rooms: Sequence[Room], stairs: Block) -> Block:
    """Return the hole in the upper storey's floor above `stairs`."""
    index = next(k for k, room in enumerate(rooms) if room.kind == "stairwell")
    return replace(stairs, kind="void", room=index, top_m=_RAIL_M)


@dataclass(frozen=True)
class _Frame:
    """Coordinates of the stairs: u from the front to the landing, v from the open side to the wall.

    Attributes:
        rect: (2, 2) the stairs in world x and y [m].
        axis: that u runs along.
        u_sign: direction of u along its axis.
    """

    rect: Array
    axis: int
    u_sign: int

    @staticmethod
    def of(block: Block) -> "_Frame":
        """Return the frame of stairs or of the void over them."""
        return _Frame(block.rect(), block.front[0], -block.front[1])

    @property
    def length_m(self) -> float:
        """Extent along u."""
        return float(self.rect[1, self.axis] - self.rect[0, self.axis])

    def point(self, u: float, v: float) -> Array:
        """Return (2,) world position."""
        xy = np.empty(2)
        # The wall is on the lower side, see `stairs_block`.
        for axis, sign, value in ((self.axis, self.u_sign, u), (1 - self.axis, -1, v)):
            xy[axis] = self.rect[0, axis] + value if sign > 0 else self.rect[1, axis] - value
        return xy

    def box(
        self, u: tuple[float, float], v: tuple[float, float], z: tuple[float, float], material: int
    ) -> Triangles:
        """Return a box between two values of each coordinate."""
        a, b = self.point(u[0], v[0]), self.point(u[1], v[1])
        return box([*np.minimum(a, b), z[0]], [*np.maximum(a, b), z[1]], material)

    def rod(
        self, start: tuple[float, float, float], end: tuple[float, float, float], material: int
    ) -> Triangles:
        """Return a square bar between two points (u, v, z)."""
        ends = [np.array([*self.point(u, v), z]) for u, v, z in (start, end)]
        return rod(ends[0], ends[1], 0.05, material)


def _flight(height_m: float) -> tuple[int, float, float]:
    """Return the risers of one of two flights up `height_m`, the height of each, and the run."""
    risers = max(round(height_m / _RISER_M / 2), 2)
    return risers, height_m / risers / 2, (risers - 1) * _TREAD_M


def eyes_on_stairs(block: Block) -> list[tuple[float, float, float]]:
    """Return eye positions [m] on both flights and the landing, above the lower floor."""
    frame, flight = _Frame.of(block), (_WIDTH_M - _SPINE_M) / 2
    _, _, run = _flight(block.top_m)
    low, high = flight / 2 + 0.05, _WIDTH_M - flight / 2
    places = (
        (0.3 * run, low, 0.15),
        (0.8 * run, low, 0.4),
        (0.5 * (run + frame.length_m), low, 0.5),
        (0.5 * (run + frame.length_m), high, 0.5),
        (0.7 * run, high, 0.65),
        (0.2 * run, high, 0.9),
    )
    return [(*frame.point(u, v).tolist(), share * block.top_m + 1.5) for u, v, share in places]


def staircase(block: Block, wood: int, wall: int, rail: int) -> list[Piece]:
    """Return the stairs with both flights closed below, and the banister at their open side.

    `wood` is the material of the treads, `wall` of risers and sides, `rail` of the banister.
    """
    frame = _Frame.of(block)
    flight, height = (_WIDTH_M - _SPINE_M) / 2, block.top_m
    risers, rise, run = _flight(height)
    first, second = (0.0, flight), (_WIDTH_M - flight, _WIDTH_M)
    parts: list[Triangles] = []

    def step(u: tuple[float, float], v: tuple[float, float], z: float, nose: float) -> None:
        top = z - _TREAD_THICK_M
        ends = (u[0] - nose, u[1]) if nose >= 0 else (u[0], u[1] - nose)
        parts.append(frame.box(u, v, (0.0, top), wall))
        parts.append(frame.box(ends, v, (top, z), wood))

    for k in range(risers - 1):
        step((k * _TREAD_M, (k + 1) * _TREAD_M), first, (k + 1) * rise, _NOSING_M)
        u = run - (k + 1) * _TREAD_M, run - k * _TREAD_M
        step(u, second, (risers + k + 1) * rise, -_NOSING_M)
    step((run, frame.length_m), (0.0, _WIDTH_M), risers * rise, 0.0)
    # The wall between the flights goes up to the height of the upper storey's railing.
    parts.append(frame.box((0.0, run), (flight, flight + _SPINE_M), (0.0, height + _RAIL_M), wall))
    foot, head = (0.03, 0.04, rise + 0.9), (run, 0.04, risers * rise + 0.9)
    posts = [
        frame.rod((u, 0.04, z), (u, 0.04, z + 0.9), rail)
        for k in range(risers - 1)
        for u, z in [((k + 0.5) * _TREAD_M, (k + 1) * rise)]
    ]
    posts.append(frame.rod((run, 0.04, risers * rise), (run, 0.04, risers * rise + 0.9), rail))
    landing = (frame.length_m, 0.04, risers * rise + 0.9)
    banister = [*posts, frame.rod(foot, head, rail), frame.rod(head, landing, rail)]
    banister.append(
        frame.box((run, frame.length_m), (0.02, 0.06), (risers * rise, risers * rise + 0.8), wall)
    )
    return [Piece("Stairs", "stairs", join(parts)), Piece("Banister", "banister", join(banister))]


def stairwell_edges(block: Block, slab_m: float, wall: int, rail: int) -> list[Piece]:
    """Return the sides of a void's opening through a slab `slab_m` thick, and its railing."""
    frame = _Frame.of(block)
    length, flight = frame.length_m, (_WIDTH_M - _SPINE_M) / 2
    corners = [
        frame.point(u, v) for u, v in ((0, 0), (length, 0), (length, _WIDTH_M), (0, _WIDTH_M))
    ]
    sides = [
        quad([*a, -slab_m], [*(b - a), 0.0], (0.0, 0.0, slab_m), wall)
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    d = _RAIL_DEPTH_M
    parts = []
    for z0, z1 in ((0.08, 0.18), (0.32, 0.42), (0.56, 0.66), (0.85, _RAIL_M)):
        parts.append(frame.box((-d, length), (-d, 0.0), (z0, z1), rail))
        parts.append(frame.box((-d, 0.0), (-d, flight), (z0, z1), rail))
    for u in np.linspace(0.0, length - 0.06, max(round(length / 0.9), 2) + 1):
        parts.append(frame.box((u - d, u), (-d, 0.0), (0.0, _RAIL_M), rail))
    parts.append(frame.box((-d, 0.0), (flight - d, flight), (0.0, _RAIL_M), rail))
    return [Piece("Wall", "wall", join(sides)), Piece("Railing", "railing", join(parts))]


def occupied_floor(block: Block) -> Array:
    """Return (2, 2) floor that a column, the stairs, or the void with its railing take."""
    if block.kind == "column":
        return block.rect()
    frame = _Frame.of(block)
    margin = _RAIL_DEPTH_M + 0.02 if block.kind == "void" else 0.0
    a, b = frame.point(-margin, -margin), frame.point(frame.length_m, _WIDTH_M)
    return np.stack([np.minimum(a, b), np.maximum(a, b)])
