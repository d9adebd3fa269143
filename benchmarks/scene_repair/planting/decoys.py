"""Openings that belong there: stairwells, lift shafts, courtyards, and what surrounds them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vlnpe.formats.core.arrays import Array

from .shapes import Outline

Corner = Array
Triangles = Array

SLAB_M, STOREY_M, RISER_M = 0.3, 2.8, 0.175
WALL_M = 0.12


@dataclass(frozen=True)
class Decoy:
    """An opening and its geometry.

    Attributes:
        name: of the added node.
        opening: what is cut out of the floor (and of the ceiling if `open_above`).
        inside: the part of it that must stay open.
        open_above: whether the sky is above.
        triangles_m: (F, 3, 3) what is added, z up [m].
    """

    name: str
    opening: Outline
    inside: Outline
    open_above: bool
    triangles_m: Triangles


@dataclass(frozen=True)
class DecoyKind:
    """Construction of openings of one kind.

    Attributes:
        build: from a free box in plan, floor height, ceiling height and a generator.
        sizes_m: least and greatest shorter side, and longer side, of the box.
    """

    build: Callable[[Corner, Corner, float, float, np.random.Generator], Decoy]
    sizes_m: tuple[tuple[float, float], tuple[float, float]]


def stairwell(
    lower: Corner, upper: Corner, floor_z: float, ceiling_z: float, rng: np.random.Generator
) -> Decoy:
    """Return stairs that lead down through the slab to a landing, between walls."""
    low, high = lower + 0.05, upper - 0.05
    along = int(high[1] - low[1] > high[0] - low[0])
    bottom = floor_z - STOREY_M
    steps = int(STOREY_M / RISER_M)
    shapes = [
        _ring(low, high, floor_z - SLAB_M, floor_z),
        _ring(low, high, bottom, floor_z - SLAB_M),
    ]
    flip = bool(rng.random() < 0.5)
    run = 0.8 * (high[along] - low[along]) / steps
    for k in range(1, steps):
        a, b = low.copy(), high.copy()
        if flip:
            b[along] = high[along] - run * (k - 1)
            a[along] = b[along] - run
        else:
            a[along] = low[along] + run * (k - 1)
            b[along] = a[along] + run
        shapes.append(_box((*a, bottom), (*b, floor_z - RISER_M * k)))
    shapes.append(_sheet(low, high, bottom))
    if rng.random() < 0.5:
        # A balustrade on the two long sides.
        for side in (0, 1):
            a, b = low.copy(), high.copy()
            across = 1 - along
            a[across] = (low[across] - 0.04) if side == 0 else high[across]
            b[across] = a[across] + 0.04
            shapes.append(_ring(a, b, floor_z, floor_z + 1.0))
            shapes.append(_sheet(a, b, floor_z + 1.0))
    return Decoy("Stairs_below", _rect(low, high), _rect(low, high), False, _joined(shapes))


def shaft(
    lower: Corner, upper: Corner, floor_z: float, ceiling_z: float, rng: np.random.Generator
) -> Decoy:
    """Return a lift shaft: walls from far below to the ceiling, perhaps a doorway, no bottom."""
    outer_low, outer_high = lower + 0.02, upper - 0.02
    low, high = outer_low + WALL_M, outer_high - WALL_M
    depth = rng.uniform(4.0, 9.0)
    shapes = [_ring(low, high, floor_z - depth, floor_z)]
    if rng.random() < 0.5:
        shapes.append(_sheet(low, high, floor_z - depth))
    door = int(rng.integers(4)) if rng.random() < 0.5 else -1
    shapes += _walls(low, high, floor_z, ceiling_z, door)
    opening = _rect(outer_low, outer_high) if door < 0 else _rect(low, high)
    return Decoy("Shaft", opening, _rect(low, high), False, _joined(shapes))


def courtyard(
    lower: Corner, upper: Corner, floor_z: float, ceiling_z: float, rng: np.random.Generator
) -> Decoy:
    """Return a courtyard: outer walls around a place without scanned ground or ceiling."""
    outer_low, outer_high = lower + 0.02, upper - 0.02
    low, high = outer_low + WALL_M, outer_high - WALL_M
    shapes = _walls(low, high, floor_z - 0.1, ceiling_z, -1)
    return Decoy(
        "Wall_court", _rect(outer_low, outer_high), _rect(low, high), True, _joined(shapes)
    )


def atrium(
    lower: Corner, upper: Corner, floor_z: float, ceiling_z: float, rng: np.random.Generator
) -> Decoy:
    """Return a void behind a balustrade, a hall's floor a storey below, a glass roof far above."""
    low, high = lower + 0.1, upper - 0.1
    bottom = floor_z - STOREY_M
    shapes = [_ring(low, high, floor_z - SLAB_M, floor_z), _sheet(low, high, bottom)]
    shapes.append(_ring(low, high, bottom, floor_z - SLAB_M))
    height = rng.uniform(0.9, 1.1)
    shapes.append(_ring(low, high, floor_z, floor_z + height))
    shapes.append(_ring(low - 0.05, high + 0.05, floor_z, floor_z + height))
    return Decoy("Balustrade", _rect(low, high), _rect(low, high), True, _joined(shapes))


DECOYS = {
    "stairwell": DecoyKind(stairwell, ((0.95, 1.2), (2.0, 3.2))),
    "shaft": DecoyKind(shaft, ((1.3, 1.8), (1.3, 2.0))),
    "courtyard": DecoyKind(courtyard, ((1.5, 2.6), (1.5, 3.0))),
    "atrium": DecoyKind(atrium, ((1.2, 2.2), (1.4, 2.8))),
}


def _walls(low: Corner, high: Corner, bottom: float, top: float, door: int) -> list[Triangles]:
    """Return four walls around a box, one with a doorway 0.9 m wide and 2.05 m high.

    They have no undersides: scanners see none.
    """
    shapes = []
    for side in range(4):
        axis, upper = side // 2, side % 2
        a, b = low - WALL_M, high + WALL_M
        a, b = a.copy(), b.copy()
        if upper:
            a[axis] = high[axis]
        else:
            b[axis] = low[axis]
        if axis == 0:
            # The other two reach around the corners.
            a[1], b[1] = low[1], high[1]
        if side != door:
            shapes.append(_ring(a, b, bottom, top))
            continue
        along = 1 - axis
        middle, half = (low[along] + high[along]) / 2, min(0.45, (high - low)[along] / 2 - 0.05)
        left_end, right_start = b.copy(), a.copy()
        left_end[along], right_start[along] = middle - half, middle + half
        shapes.append(_ring(a, left_end, bottom, top))
        shapes.append(_ring(right_start, b, bottom, top))
        over_a, over_b = a.copy(), b.copy()
        over_a[along], over_b[along] = middle - half, middle + half
        shapes.append(_box((*over_a, bottom + 2.05), (*over_b, top)))
    return shapes


def _rect(low: Corner, high: Corner) -> Outline:
    (x0, y0), (x1, y1) = low, high
    return Outline([np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])])


def _ring(low: Corner, high: Corner, bottom: float, top: float) -> Triangles:
    """Return the four upright sides of a box."""
    (x0, y0), (x1, y1) = low, high
    loop = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    triangles = []
    for k in range(4):
        (ax, ay), (bx, by) = loop[k], loop[(k + 1) % 4]
        triangles += _quad((ax, ay, bottom), (bx, by, bottom), (bx, by, top), (ax, ay, top))
    return np.array(triangles)


def _sheet(low: Corner, high: Corner, z: float) -> Triangles:
    (x0, y0), (x1, y1) = low, high
    return np.array(_quad((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Triangles:
    a, b = np.array(low[:2]), np.array(high[:2])
    bottom = _sheet(a, b, low[2])[:, ::-1]
    return np.concatenate([_ring(a, b, low[2], high[2]), _sheet(a, b, high[2]), bottom])


def _quad(a: tuple, b: tuple, c: tuple, d: tuple) -> list[list[tuple]]:
    return [[a, b, c], [a, c, d]]


def _joined(shapes: list[Triangles]) -> Triangles:
    return np.concatenate(shapes)
