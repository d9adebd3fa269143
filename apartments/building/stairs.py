"""A staircase in its stairwell, the opening above it and its railings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...formats.core.arrays import Array
from .flights import BEFORE_M, FLIGHT_M, SETBACK_M, SPINE_M, Flight, Span, Stairs, lay_out
from .furniture.piece import Piece
from .plan import SIDES, Block, Room
from .shapes import Triangles, box, join, quad, rod

_NOSING_M, _TREAD_THICK_M = 0.02, 0.035
_RAIL_M, _RAIL_DEPTH_M = 0.95, 0.06
# A banister stands this far inside of a flight's open side, and is so high over its treads.
_BANISTER_M, _HANDRAIL_M = 0.04, 0.9


def stairs_block(
    rooms: Sequence[Room], wall_m: float, rise_m: float, shape: str, steps_m: Span
) -> Block:
    """Return the stairs in the stairwell among the lower storey's `rooms`, `rise_m` high.

    L- and U-shaped stairs begin at the hallway, along a side wall of the stairwell; straight ones
    run along the wall opposite to the hallway.

    Args:
        shape, steps_m: see `lay_out`.
    """
    index = next(k for k, room in enumerate(rooms) if room.kind == "stairwell")
    room, hall = rooms[index], next(r for r in rooms if r.kind == "hallway")
    axis, sign = next(
        (a, s)
        for a, s in SIDES
        if abs(hall.wall_at(a, -s) - room.wall_at(a, s) - s * wall_m) < 1e-6
    )
    stairs = lay_out(shape, rise_m, steps_m, float(room.size_m[axis]))
    rect = np.array([room.lower_m, room.upper_m])
    if shape == "straight":
        stairs = replace(stairs, wall_sign=-sign)
        rect[int(sign > 0), axis] = room.wall_at(axis, -sign) + sign * stairs.size_m[1]
        axis, sign = 1 - axis, -1
        rect[0, axis] += (room.size_m[axis] - stairs.size_m[0]) / 2
        rect[1, axis] = rect[0, axis] + stairs.size_m[0]
    else:
        rect[int(sign > 0), axis] -= sign * SETBACK_M[shape]
        rect[1, 1 - axis] = rect[0, 1 - axis] + stairs.size_m[1]
    low, high = rect.tolist()
    ends = (low[0], low[1]), (high[0], high[1])
    return Block("stairs", index, *ends, rise_m, front=(axis, sign), stairs=stairs)


def upper_void(rooms: Sequence[Room], stairs: Block) -> Block:
    """Return the hole in the upper storey's floor above `stairs`."""
    index = next(k for k, room in enumerate(rooms) if room.kind == "stairwell")
    return replace(stairs, kind="void", room=index, top_m=_RAIL_M)


@dataclass(frozen=True)
class _Frame:
    """Coordinates of the stairs: u from the front, v from the open side to the wall along them.

    Attributes:
        rect: (2, 2) the stairs in world x and y [m].
        axis: that u runs along.
        u_sign, v_sign: directions of u and v along their axes.
    """

    rect: Array
    axis: int
    u_sign: int
    v_sign: int

    @staticmethod
    def of(block: Block) -> tuple["_Frame", Stairs]:
        """Return the frame and the plan of stairs or of the void over them."""
        if block.stairs is None:
            raise ValueError(f"a {block.kind} has no stairs; valid: stairs, void")
        axis, sign = block.front
        return _Frame(block.rect(), axis, -sign, block.stairs.wall_sign), block.stairs

    def point(self, u: float, v: float) -> Array:
        """Return (2,) world position."""
        xy = np.empty(2)
        for axis, sign, value in ((self.axis, self.u_sign, u), (1 - self.axis, self.v_sign, v)):
            xy[axis] = self.rect[0, axis] + value if sign > 0 else self.rect[1, axis] - value
        return xy

    def rectangle(self, u: Span, v: Span) -> Array:
        """Return (2, 2) lower and upper corner in the world."""
        a, b = self.point(u[0], v[0]), self.point(u[1], v[1])
        return np.stack([np.minimum(a, b), np.maximum(a, b)])

    def box(self, u: Span, v: Span, z: Span, material: int) -> Triangles:
        """Return a box between two values of each coordinate."""
        low, high = self.rectangle(u, v)
        return box([*low, z[0]], [*high, z[1]], material)

    def rod(self, start: Sequence[float], end: Sequence[float], material: int) -> Triangles:
        """Return a square bar between two points (u, v, z)."""
        ends = [np.array([*self.point(u, v), z]) for u, v, z in (start, end)]
        return rod(ends[0], ends[1], 0.05, material)


def _uv(flight: Flight, along: float, across: float) -> tuple[float, float]:
    """Return u and v of a place `along` a flight from its first riser."""
    place = flight.foot_m + flight.sign * along
    return (place, across) if flight.axis == 0 else (across, place)


def _spans(flight: Flight, start: float, end: float, across: Span) -> tuple[Span, Span]:
    """Return the extents along u and v of a stretch of a flight, from its first riser."""
    a, b = flight.foot_m + flight.sign * start, flight.foot_m + flight.sign * end
    along = (min(a, b), max(a, b))
    return (along, across) if flight.axis == 0 else (across, along)


def eyes_on_stairs(block: Block) -> list[tuple[float, float, float]]:
    """Return eye positions [m] on all flights and the landing, above the lower floor."""
    frame, stairs = _Frame.of(block)
    risers = sum(flight.risers for flight in stairs.flights)
    places: list[tuple[float, float, float]] = []
    for k, flight in enumerate(stairs.flights):
        run, lane = stairs.run_m(flight), flight.lane_m()
        for share in (0.15, 0.4, 0.65, 0.9) if stairs.landing_m is None else (0.3, 0.8):
            height = (flight.before + share * flight.risers) / risers
            places.append((*_uv(flight, share * run, lane), height))
        if k == 0 and stairs.landing_m:
            places += [(*corner, flight.risers / risers) for corner in _across_landing(stairs)]
    return [(*frame.point(u, v).tolist(), share * block.top_m + 1.5) for u, v, share in places]


def _across_landing(stairs: Stairs) -> list[tuple[float, float]]:
    """Return places (u, v) on the landing, from the end of one flight to the foot of the next."""
    if stairs.landing_m is None:
        return []
    (u0, u1), _ = stairs.landing_m
    first, second = stairs.flights
    if second.axis == 1:
        return [(second.lane_m(), first.lane_m())]
    return [(0.5 * (u0 + u1), flight.lane_m()) for flight in stairs.flights]


def staircase(block: Block, wood: int, wall: int, rail: int) -> list[Piece]:
    """Return the stairs with all flights closed below, and the banisters at their open sides.

    `wood` is the material of the treads, `wall` of risers and sides, `rail` of the banisters.
    """
    frame, stairs = _Frame.of(block)
    rise, tread = stairs.riser_m, stairs.tread_m
    parts: list[Triangles] = []

    def step(place: tuple[Span, Span], nosed: tuple[Span, Span], z: float) -> None:
        top = z - _TREAD_THICK_M
        parts.append(frame.box(*place, (0.0, top), wall))
        parts.append(frame.box(*nosed, (top, z), wood))

    for k in range(max(flight.risers for flight in stairs.flights) - 1):
        for flight in (f for f in stairs.flights if k < f.risers - 1):
            spans = [
                _spans(flight, k * tread - nose, (k + 1) * tread, flight.across_m)
                for nose in (0.0, _NOSING_M)
            ]
            step(spans[0], spans[1], (flight.before + k + 1) * rise)
    first = stairs.flights[0]
    bars = [bar for flight in stairs.flights for bar in _banister(frame, stairs, flight, rail)]
    if stairs.landing_m:
        step(stairs.landing_m, stairs.landing_m, first.risers * rise)
    if stairs.landing_m and stairs.shape == "U":
        # The wall between the flights goes up to the height of the upper storey's railing.
        between = (FLIGHT_M, FLIGHT_M + SPINE_M)
        top = (0.0, block.top_m + _RAIL_M)
        parts.append(frame.box((0.0, stairs.run_m(first)), between, top, wall))
        (u0, u1), z = stairs.landing_m[0], first.risers * rise
        start, end = ((u, _BANISTER_M, z + _HANDRAIL_M) for u in (u0, u1))
        bars.append(frame.rod(start, end, rail))
        across = (_BANISTER_M - 0.02, _BANISTER_M + 0.02)
        bars.append(frame.box((u0, u1), across, (z, z + 0.8), wall))
    return [Piece("Stairs", "stairs", join(parts)), Piece("Banister", "banister", join(bars))]


def _banister(frame: _Frame, stairs: Stairs, flight: Flight, rail: int) -> list[Triangles]:
    """Return the posts and the handrail at the open side of a flight."""
    if flight.open_m is None:
        return []
    rise, tread = stairs.riser_m, stairs.tread_m
    inwards = 1 if flight.open_m == flight.across_m[0] else -1
    across = flight.open_m + inwards * _BANISTER_M
    posts = [((k + 0.5) * tread, k + 1) for k in range(flight.risers - 1)]
    posts.append((stairs.run_m(flight), flight.risers))
    bars = []
    for along, count in posts:
        place, z = _uv(flight, along, across), (flight.before + count) * rise
        bars.append(frame.rod((*place, z), (*place, z + _HANDRAIL_M), rail))
    ends = ((0.03, 1), (stairs.run_m(flight), flight.risers))
    foot, head = (
        (*_uv(flight, along, across), (flight.before + count) * rise + _HANDRAIL_M)
        for along, count in ends
    )
    return [*bars, frame.rod(foot, head, rail)]


def stairwell_edges(block: Block, slab_m: float, wall: int, rail: int) -> list[Piece]:
    """Return the sides of a void's opening through a slab `slab_m` thick, and its railing."""
    frame, stairs = _Frame.of(block)
    length, width = stairs.size_m
    corners = [frame.point(u, v) for u, v in ((0, 0), (length, 0), (length, width), (0, width))]
    sides = [
        quad([*a, -slab_m], [*(b - a), 0.0], (0.0, 0.0, slab_m), wall)
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    d, (front, side) = _RAIL_DEPTH_M, stairs.rails_m
    parts = []
    for z in ((0.08, 0.18), (0.32, 0.42), (0.56, 0.66), (0.85, _RAIL_M)):
        parts.append(frame.box((-d, side), (-d, 0.0), z, rail))
        parts.append(frame.box((-d, 0.0), (-d, front), z, rail))
    for u in np.linspace(0.0, side - 0.06, max(round(side / 0.9), 2) + 1):
        parts.append(frame.box((u - d, u), (-d, 0.0), (0.0, _RAIL_M), rail))
    parts.append(frame.box((-d, 0.0), (front - d, front), (0.0, _RAIL_M), rail))
    return [Piece("Wall", "wall", join(sides)), Piece("Railing", "railing", join(parts))]


def occupied_floor(block: Block) -> Array:
    """Return (2, 2) floor that a column, the stairs, or the void with its railing take."""
    if block.kind == "column":
        return block.rect()
    frame, stairs = _Frame.of(block)
    margin = _RAIL_DEPTH_M + 0.02 if block.kind == "void" else 0.0
    return frame.rectangle((-margin, stairs.size_m[0]), (-margin, stairs.size_m[1]))


def floor_at_ends(block: Block) -> Array:
    """Return (2, 2) the floor before the foot of stairs, or behind the head below a void."""
    frame, stairs = _Frame.of(block)
    flight = stairs.flights[-1 if block.kind == "void" else 0]
    run = stairs.run_m(flight)
    start, end = (run, run + BEFORE_M) if block.kind == "void" else (-BEFORE_M, 0.0)
    return frame.rectangle(*_spans(flight, start, end, flight.across_m))
