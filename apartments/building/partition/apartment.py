"""Families of partitions: how the rectangle of a home falls into rooms.

Each family returns cells `(role, x0, y0, x1, y1)` on the walls' centre lines. Roles: `living`,
`hall`, `wet` (a bathroom), `room` (anything else); the plan turns them into room kinds by size.
"""

from collections.abc import Callable

import numpy as np

Cell = tuple[str, float, float, float, float]


def cuts(rng: np.random.Generator, length: float, least: list[float]) -> list[float]:
    """Cut `length` into pieces of at least `least` each; small pieces (bathrooms) grow little."""
    spare = max(length - sum(least), 0.0)
    share = rng.dirichlet([0.8 if piece < 2.5 else 5.0 for piece in least]) * spare
    return list(np.cumsum([0.0, *(a + b for a, b in zip(least, share, strict=True))]))


def row(
    rng: np.random.Generator, x0: float, x1: float, y0: float, y1: float, roles: list[str]
) -> list[Cell]:
    """Return a row of rooms side by side along x."""
    least = [2.1 if role == "wet" else 3.1 for role in roles]
    at = cuts(rng, x1 - x0, least)
    return [(role, x0 + at[k], y0, x0 + at[k + 1], y1) for k, role in enumerate(roles)]


def shuffled(rng: np.random.Generator, roles: list[str]) -> list[str]:
    """Return the roles in random order."""
    return [roles[k] for k in rng.permutation(len(roles))]


def corridor(rng: np.random.Generator) -> list[Cell]:
    """Return a central corridor with rooms on both sides, living room and kitchen at its end."""
    width, depth = rng.uniform(10.8, 13.6), rng.uniform(8.2, 9.8)
    end = rng.uniform(4.2, 5.2)
    low = rng.uniform(3.1, 3.8)
    high = low + rng.uniform(1.5, 1.8)
    length = width - end
    split = rng.uniform(0.56, 0.64) * depth
    split = float(np.clip(split, high + 0.2, depth - 2.9))
    if depth - split < 2.9:
        split = low + 1.6
    cells: list[Cell] = [
        ("living", 0.0, 0.0, end, split),
        ("room", 0.0, split, end, depth),
        ("hall", end, low, width, high),
    ]
    small, large = (["wet", "room"], ["room", "room"])
    below, above = (small, large) if rng.random() < 0.5 else (large, small)
    if length > 8.4:
        below = [*below, "room"]
    # A recess in the outline: not every home is one rectangle.
    recess = rng.uniform(0.0, 0.5) if rng.random() < 0.5 else 0.0
    cells += row(rng, end, width, recess, low, shuffled(rng, below))
    cells += row(rng, end, width, high, depth, shuffled(rng, above))
    return cells


def hub(rng: np.random.Generator) -> list[Cell]:
    """Return a large living room in the middle, rooms on both sides, a small entrance hall."""
    left, middle, right = rng.uniform(3.2, 4.0), rng.uniform(4.2, 5.2), rng.uniform(3.2, 4.0)
    depth = rng.uniform(8.4, 10.0)
    hall = rng.uniform(1.9, 2.4)
    cells: list[Cell] = [
        ("living", left, hall, left + middle, depth),
        ("hall", left, 0.0, left + middle, hall),
    ]
    for x0, x1, roles in (
        (0.0, left, ["wet", "room", "room"]),
        (left + middle, left + middle + right, ["room", "room"]),
    ):
        order = shuffled(rng, roles)
        at = cuts(rng, depth, [2.1 if role == "wet" else 3.0 for role in order])
        cells += [(role, x0, at[k], x1, at[k + 1]) for k, role in enumerate(order)]
    return cells


def gallery(rng: np.random.Generator) -> list[Cell]:
    """Return a long home: a corridor along one outer wall, rooms in a row, full-depth ends."""
    width, depth = rng.uniform(14.0, 16.4), rng.uniform(6.2, 7.2)
    first, last = rng.uniform(4.0, 4.8), rng.uniform(3.3, 3.8)
    hall = rng.uniform(1.5, 1.9)
    cells: list[Cell] = [
        ("living", 0.0, 0.0, first, depth),
        ("room", width - last, 0.0, width, depth),
        ("hall", first, 0.0, width - last, hall),
    ]
    roles = ["wet", "room"]
    if width - first - last > 8.3:
        roles.append("room")
    cells += row(rng, first, width - last, hall, depth, shuffled(rng, roles))
    return cells


FAMILIES: dict[str, Callable[[np.random.Generator], list[Cell]]] = {
    "corridor": corridor,
    "hub": hub,
    "gallery": gallery,
}


def oriented(rng: np.random.Generator, cells: list[Cell]) -> list[Cell]:
    """Mirror and transpose at random, so that homes of one family differ."""
    flip_x, flip_y, swap = rng.random(3) < 0.5
    x_max, y_max = max(c[3] for c in cells), max(c[4] for c in cells)
    result: list[Cell] = []
    for role, x0, y0, x1, y1 in cells:
        if flip_x:
            x0, x1 = x_max - x1, x_max - x0
        if flip_y:
            y0, y1 = y_max - y1, y_max - y0
        if swap:
            x0, y0, x1, y1 = y0, x0, y1, x1
        result.append((role, x0, y0, x1, y1))
    return result
