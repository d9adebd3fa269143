"""Partitions of large buildings: villas, two-storey houses, offices.

As in `partition`, a family returns cells on the walls' centre lines. The role `stairs` is the cell
of a staircase; in an office the roles are the kinds of the rooms.
"""

from collections.abc import Callable

import numpy as np

from .apartment import Cell, cuts, row, shuffled

_LEAST_ROOM_M = 3.0


def _rooms_along(rng: np.random.Generator, length_m: float, wet: int) -> list[str]:
    """Return roles of a row of rooms along `length_m`: the bathrooms, and as many rooms as fit."""
    count = int((length_m - 2.4 * wet) // rng.uniform(3.9, 4.9))
    return shuffled(rng, ["wet"] * wet + ["room"] * max(count, 1))


def _column(
    rng: np.random.Generator, x0: float, x1: float, y0: float, y1: float, roles: list[str]
) -> list[Cell]:
    """Return the rooms one behind the other along y."""
    at = cuts(rng, y1 - y0, [2.2 if role == "wet" else _LEAST_ROOM_M for role in roles])
    return [(role, x0, y0 + at[k], x1, y0 + at[k + 1]) for k, role in enumerate(roles)]


def spine(rng: np.random.Generator) -> list[Cell]:
    """Return a long corridor with rooms on both sides, living room and kitchen at one end."""
    width, end = rng.uniform(19.0, 24.0), rng.uniform(5.4, 7.0)
    low = rng.uniform(4.0, 5.2)
    high = low + rng.uniform(1.6, 2.0)
    depth = high + rng.uniform(4.0, 5.2)
    split = rng.uniform(0.52, 0.6) * depth
    split = float(np.clip(split, high + 0.2, depth - 3.2))
    cells: list[Cell] = [
        ("living", 0.0, 0.0, end, split),
        ("room", 0.0, split, end, depth),
        ("hall", end, low, width, high),
    ]
    below, above = (1, 1) if rng.random() < 0.5 else (0, 2)
    length = width - end
    recess = rng.uniform(0.0, 0.6)
    cells += row(rng, end, width, recess, low, _rooms_along(rng, length, below))
    cells += row(rng, end, width, high, depth, _rooms_along(rng, length, above))
    return cells


def wings(rng: np.random.Generator) -> list[Cell]:
    """Return two wings at a right angle, each with a corridor."""
    width, depth = rng.uniform(16.0, 19.5), rng.uniform(15.5, 19.0)
    low = rng.uniform(4.0, 5.0)
    high = low + rng.uniform(1.6, 1.9)
    inner = high + rng.uniform(3.9, 4.8)
    right = width - rng.uniform(3.9, 4.8)
    left = right - rng.uniform(1.6, 1.9)
    outer = left - rng.uniform(3.9, 4.8)
    end = rng.uniform(5.2, 6.2)
    cells: list[Cell] = [
        ("hall", end, low, width, high),
        ("hall", left, high, right, depth),
        ("living", 0.0, 0.0, end, inner),
    ]
    cells += row(rng, end, width, 0.0, low, _rooms_along(rng, width - end, 1))
    cells += row(rng, end, left, high, inner, ["room"])
    cells += _column(rng, outer, left, inner, depth, ["room"])
    cells += _column(rng, right, width, high, depth, shuffled(rng, ["wet", "room", "room"]))
    return cells


def middle(rng: np.random.Generator) -> list[Cell]:
    """Return living room and kitchen in the middle, with a corridor and rooms on both sides."""
    first, last = rng.uniform(6.6, 8.4), rng.uniform(6.6, 8.4)
    center = rng.uniform(5.4, 7.0)
    low = rng.uniform(4.0, 5.2)
    high = low + rng.uniform(1.6, 1.9)
    depth = high + rng.uniform(4.0, 5.2)
    split = float(np.clip(rng.uniform(0.56, 0.64) * depth, high + 0.2, depth - 3.2))
    a, b, width = first, first + center, first + center + last
    cells: list[Cell] = [
        ("living", a, 0.0, b, split),
        ("room", a, split, b, depth),
        ("hall", 0.0, low, a, high),
        ("hall", b, low, width, high),
    ]
    wet = shuffled(rng, ["wet", "room"])
    cells += row(rng, 0.0, a, 0.0, low, shuffled(rng, ["room", "room"]))
    cells += row(rng, 0.0, a, high, depth, shuffled(rng, ["wet", "room"]))
    cells += row(rng, b, width, 0.0, low, wet)
    cells += row(rng, b, width, high, depth, ["room", "room"])
    return cells


VILLAS: dict[str, Callable[[np.random.Generator], list[Cell]]] = {
    "middle": middle,
    "spine": spine,
    "wings": wings,
}


STAIRWELL_DEPTH_M = (3.5, 4.0)
_NARROWEST_M = 3.2


def house(rng: np.random.Generator, stairs_m: tuple[float, float]) -> list[list[Cell]]:
    """Return two storeys of one outline: a corridor, rooms before it, rooms and stairs behind.

    `stairs_m` are the least extents of the stairwell, along the corridor and away from it [m].
    """
    width = rng.uniform(11.4, 13.0)
    low = rng.uniform(3.9, 4.6)
    high = low + rng.uniform(1.7, 2.0)
    depth = high + max(rng.uniform(*STAIRWELL_DEPTH_M), stairs_m[1])
    bathroom = rng.uniform(2.5, 2.9)
    stairwell = max(rng.uniform(3.5, 3.8), stairs_m[0])
    width = max(width, _NARROWEST_M + stairwell + bathroom)
    right = width - bathroom
    left = right - stairwell
    # Downstairs the living room takes the corridor's end, as far as the stairs allow.
    end = min(rng.uniform(4.2, 5.4), left)
    back: list[Cell] = [
        *row(rng, 0.0, left, high, depth, ["room"] * (2 if left > 6.4 else 1)),
        ("stairs", left, high, right, depth),
        ("wet", right, high, width, depth),
    ]
    ground: list[Cell] = [
        *back,
        ("hall", end, low, width, high),
        ("living", 0.0, 0.0, end, high),
        *row(rng, end, width, 0.0, low, ["room", "room"]),
    ]
    count = min(int(width // rng.uniform(3.9, 4.6)), 3)
    upper: list[Cell] = [
        *back,
        ("hall", 0.0, low, width, high),
        *row(rng, 0.0, width, 0.0, low, ["room"] * count),
    ]
    return [ground, upper]


def office(rng: np.random.Generator) -> list[Cell]:
    """Return an open-plan office, a corridor along it, and a row of small rooms behind that."""
    width = rng.uniform(22.0, 30.0)
    low = rng.uniform(9.5, 12.5)
    high = low + rng.uniform(1.9, 2.3)
    depth = high + rng.uniform(4.2, 5.0)
    cells: list[Cell] = [("hallway", 0.0, low, width, high)]
    if width > 26.0 and rng.random() < 0.6:
        cut = rng.uniform(0.45, 0.62) * width
        cells += [("office", 0.0, 0.0, cut, low), ("office", cut, 0.0, width, low)]
    else:
        cells.append(("office", 0.0, 0.0, width, low))
    roles = ["kitchen", "bathroom", "bathroom", "storeroom", "meeting room", "meeting room"]
    while len(roles) * 3.6 < width - 3.6:
        roles.append("meeting room")
    roles = shuffled(rng, roles)
    least = {"kitchen": 3.4, "bathroom": 2.3, "storeroom": 2.3, "meeting room": 3.4}
    at = cuts(rng, width, [least[role] for role in roles])
    cells += [(role, at[k], high, at[k + 1], depth) for k, role in enumerate(roles)]
    return cells
