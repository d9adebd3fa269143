"""Furniture of offices: desk islands, conference tables, whiteboards, filing cabinets."""

import numpy as np

from ...materials import pictures
from ...materials.kit import Kit
from ..shapes import Triangles, box, join, quad
from .piece import Arrangement, Piece
from .seating import office_chair

_DESK_M, _DESK_DEPTH_M = 1.4, 0.72


def _desk(kit: Kit, wood: int) -> list[Triangles]:
    """Return a desk with a screen and a keyboard; its user sits towards +y."""
    w, d = _DESK_M / 2, _DESK_DEPTH_M
    monitor = kit.palette.unique("screen", pictures.screen, (0.56, 0.34))
    return [
        box((-w, 0.0, 0.71), (w, d, 0.75), wood),
        box((-w, 0.04, 0.0), (-w + 0.05, d - 0.04, 0.71), kit.white),
        box((w - 0.05, 0.04, 0.0), (w, d - 0.04, 0.71), kit.white),
        box((-0.3, 0.14, 0.86), (0.3, 0.17, 1.22), kit.black),
        quad((0.28, 0.173, 0.87), (-0.56, 0, 0), (0, 0, 0.34), monitor),
        box((-0.03, 0.1, 0.75), (0.03, 0.14, 1.0), kit.black),
        box((-0.12, 0.08, 0.75), (0.12, 0.28, 0.77), kit.black),
        box((-0.22, 0.4, 0.75), (0.22, 0.54, 0.775), kit.plain("keys", (70, 72, 76))),
    ]


def desk_island(kit: Kit, rng: np.random.Generator, pairs: int) -> Arrangement:
    """Return desks in two rows, back to back, with low screens between and a chair at each."""
    wood = kit.wood(int(rng.integers(3)))
    length = pairs * _DESK_M
    cloth = kit.cloth(int(rng.integers(8)))
    screen = box((-length / 2, -0.025, 0.45), (length / 2, 0.025, 1.15), cloth)
    pieces = [Piece("Partition", "partition", screen)]
    for side in range(2):
        for k in range(pairs):
            x = -length / 2 + (k + 0.5) * _DESK_M
            desk = Piece("Desk", "desk", join(_desk(kit, wood)))
            pieces.append(desk.moved(0.0, 0.0, 0.03).moved(side * np.pi, x, 0.0))
            # Pushed back or tucked in, but never through the desk's leg or the neighbour's chair.
            turn = np.pi + float(rng.normal(0, 0.25))
            chair = office_chair(kit, rng).moved(0.0, 0.0, -0.3).moved(turn)
            y = _DESK_DEPTH_M + 0.36 + float(rng.uniform(0.0, 0.15))
            pieces.append(chair.moved(0.0, 0.0, y).moved(side * np.pi, x, 0.0))
    return Arrangement(tuple(pieces), 0.0, wall=False, on_window=True)


def conference_set(kit: Kit, rng: np.random.Generator, seats: int) -> Arrangement:
    """Return a long table in the middle of a room with swivel chairs along both sides."""
    wood = kit.wood(int(rng.integers(3)))
    half = seats // 2
    w, d = 0.375 * half + 0.1, 0.5
    table = [box((-w, -d, 0.71), (w, d, 0.75), wood)]
    for x in (-w + 0.35, w - 0.35):
        table.append(box((x - 0.04, -d + 0.2, 0.0), (x + 0.04, d - 0.2, 0.71), kit.black))
    pieces = [Piece("Conference_table", "conference table", join(table))]
    for side in range(2):
        for k in range(half):
            x = (k - (half - 1) / 2) * 0.75
            turn = np.pi + float(rng.normal(0, 0.15))
            chair = office_chair(kit, rng).moved(0.0, 0.0, -0.3).moved(turn)
            pieces.append(chair.moved(0.0, 0.0, d + 0.38).moved(side * np.pi, x, 0.0))
    return Arrangement(tuple(pieces), 0.0, wall=False, on_window=True)


def whiteboard(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a whiteboard on a stand with feet, at the wall."""
    w, metal = float(rng.uniform(0.6, 0.8)), kit.metal
    white = kit.plain("whiteboard", (244, 245, 245))
    posts = (-w + 0.1, w - 0.1)
    parts = [
        box((-w, 0.06, 0.85), (w, 0.09, 1.85), metal),
        quad((w - 0.03, 0.093, 0.88), (-2 * w + 0.06, 0, 0), (0, 0, 0.94), white),
        *(box((x - 0.03, 0.05, 0.0), (x + 0.03, 0.1, 0.85), metal) for x in posts),
        *(box((x - 0.03, 0.0, 0.0), (x + 0.03, 0.4, 0.05), metal) for x in posts),
    ]
    return Piece("Whiteboard", "whiteboard", join(parts))


def filing_cabinet(kit: Kit, rng: np.random.Generator, doors: int) -> Piece:
    """Return a steel cabinet of chest height."""
    k, width, height = int(rng.integers(6)), 0.45 * doors, float(rng.uniform(1.0, 1.3))
    front = kit.front(width - 0.03, height - 0.1, 3, doors, k)
    parts = [
        box((-width / 2, 0.0, 0.0), (width / 2, 0.44, height), kit.front_color(k)),
        quad((width / 2 - 0.015, 0.445, 0.06), (-width + 0.03, 0, 0), (0, 0, height - 0.1), front),
    ]
    return Piece("Filing_cabinet", "filing cabinet", join(parts))
