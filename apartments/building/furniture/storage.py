"""Cupboards, shelves and what is in them."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ...materials import pictures
from ...materials.kit import Kit
from ..shapes import Triangles, box, cylinder, join, quad, turned
from .piece import Piece
from .tables import books, vase


def _front(width: float, y: float, z0: float, height: float, material: int) -> Triangles:
    # Seen from +y, right is −x.
    return quad((width / 2, y, z0), (-width, 0.0, 0.0), (0.0, 0.0, height), material)


def _doors(
    kit: Kit, width: float, y: float, z0: float, height: float,
    pattern: tuple[int, int, int], wood: bool = False,
) -> Triangles:  # fmt: skip
    """Return a front of doors or drawers; `pattern` is its rows, its columns, and its colour."""
    return _front(width, y, z0, height, kit.front(width, height, *pattern, wood))


def _body(kit: Kit, rng: np.random.Generator, k: int, share: float) -> tuple[bool, int]:
    """Return whether a cupboard is of wood, as `share` of them are, and its material."""
    wooden = rng.random() < share
    return wooden, kit.wood(k) if wooden else kit.front_color(k)


def _feet(x: float, ys: Sequence[float], height: float, material: int) -> list[Triangles]:
    """Return square feet at ±x, which begin at each of `ys`."""
    places = product((-x, x), ys)
    return [box((at - 0.03, y, 0.0), (at + 0.03, y + 0.06, height), material) for at, y in places]


def bookshelf(kit: Kit, rng: np.random.Generator) -> Piece:
    """Open shelves filled with books, boxes and a vase or two."""
    k = int(rng.integers(3))
    wood = kit.wood(k) if rng.random() < 0.7 else kit.white
    width, depth = float(rng.uniform(0.8, 1.3)), 0.3
    shelves = int(rng.integers(4, 6))
    step = float(rng.uniform(0.33, 0.38))
    w, height = width / 2, 0.08 + shelves * step
    parts = [
        box((-w, 0.0, 0.0), (-w + 0.03, depth, height), wood),
        box((w - 0.03, 0.0, 0.0), (w, depth, height), wood),
        box((-w, 0.0, 0.0), (w, 0.015, height), wood),
        box((-w, 0.0, 0.0), (w, depth - 0.02, 0.08), wood),
    ]
    for s in range(shelves + 1):
        z = 0.06 + s * step
        parts.append(box((-w, 0.0, z), (w, depth, z + 0.03), wood))
        if s == shelves:
            break
        x, gap, low = -w + 0.04, step - 0.05, z + 0.03
        while x < w - 0.2:
            length = min(float(rng.uniform(0.25, 0.6)), w - 0.04 - x)
            kind = rng.random()
            if kind < 0.68:
                size = (length, gap)
                spines = kit.palette.unique("books", pictures.book_spines, size, (150, 130, 110))
                face = 0.06 + float(rng.uniform(0.12, 0.17))
                parts.append(quad((x + length, face, low), (-length, 0, 0), (0, 0, gap), spines))
                end = (x + length, face - 0.004, low + 0.62 * gap)
                parts.append(box((x, 0.02, low), end, kit.plain("pages", (226, 218, 200))))
            elif kind < 0.84:
                end = (x + length - 0.02, depth - 0.03, low + 0.65 * gap)
                parts.append(box((x + 0.02, 0.03, low), end, kit.wicker))
            x += length + 0.02
    parts += vase(kit, 0.3 * w, 0.14, height + 0.01)
    return Piece("Bookshelf", "bookshelf", join(parts))


def wardrobe(kit: Kit, rng: np.random.Generator, doors: int) -> Piece:
    """Return a tall wardrobe, half a metre per door."""
    k = int(rng.integers(6))
    width, depth, height = 0.5 * doors, 0.58, float(rng.uniform(2.0, 2.2))
    w = width / 2
    wooden, body = _body(kit, rng, k, 0.5)
    parts = [
        box((-w, 0.0, 0.0), (w, depth, height), body),
        _doors(kit, width, depth + 0.004, 0.06, height - 0.06, (1, doors, k), wooden),
        box((-w - 0.015, 0.0, height), (w + 0.015, depth + 0.02, height + 0.035), body),
    ]
    if rng.random() < 0.6:
        parts.append(box((-0.3, 0.1, height + 0.035), (0.15, 0.45, height + 0.24), kit.wicker))
    return Piece("Wardrobe", "wardrobe", join(parts))


def dresser(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a chest of drawers with things on it."""
    k, width, height = int(rng.integers(6)), float(rng.uniform(0.85, 1.15)), 0.82
    wooden, body = _body(kit, rng, k, 0.6)
    parts = [
        box((-width / 2, 0.0, 0.08), (width / 2, 0.44, height), body),
        *_feet(width / 2 - 0.05, (0.02, 0.37), 0.1, body),
        _doors(kit, width - 0.04, 0.445, 0.1, height - 0.13, (3, 2, k), wooden),
        *vase(kit, -0.3 * width, 0.2, height),
        *books(kit, rng, 0.25 * width, 0.22, height),
    ]
    return Piece("Dresser", "dresser", join(parts))


def sideboard(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a low, long cupboard with a table lamp."""
    k, width, height = int(rng.integers(6)), float(rng.uniform(1.3, 1.7)), 0.78
    wooden, body = _body(kit, rng, k, 0.7)
    x = 0.36 * width
    parts = [
        box((-width / 2, 0.0, 0.12), (width / 2, 0.42, height), body),
        *_feet(width / 2 - 0.08, (0.03, 0.33), 0.13, kit.black),
        _doors(kit, width - 0.04, 0.425, 0.14, height - 0.17, (1, 4, k), wooden),
        *table_lamp_parts(kit, x, 0.2, height),
        *books(kit, rng, -0.1, 0.2, height),
        *vase(kit, -0.36 * width, 0.2, height),
    ]
    return Piece("Sideboard", "sideboard", join(parts))


def tv_stand(kit: Kit, rng: np.random.Generator, width: float) -> list[Piece]:
    """Return a low board and the television on it."""
    k = int(rng.integers(6))
    wooden, body = _body(kit, rng, k, 0.6)
    board = [
        box((-width / 2, 0.0, 0.1), (width / 2, 0.4, 0.48), body),
        *_feet(width / 2 - 0.12, (0.04, 0.3), 0.11, kit.black),
        _doors(kit, width - 0.04, 0.405, 0.12, 0.34, (1, 3, k), wooden),
        box((0.34 * width, 0.08, 0.48), (0.34 * width + 0.2, 0.3, 0.56), kit.black),
    ]
    tw, th = 0.72 * width, 0.4 * width
    picture = kit.palette.unique("tv", pictures.screen, (tw, th))
    screen = [
        box((-tw / 2, 0.12, 0.56), (tw / 2, 0.17, 0.56 + th), kit.black),
        _front(tw, 0.174, 0.56, th, picture),
        box((-0.2, 0.08, 0.48), (0.2, 0.26, 0.5), kit.black),
        box((-0.04, 0.11, 0.48), (0.04, 0.15, 0.6), kit.black),
    ]
    television = Piece("Television", "television", join(screen))
    return [Piece("TV_stand", "tv stand", join(board)), television]


def shoe_cabinet(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a shallow cabinet for a hallway, with a bowl for keys."""
    k, width = int(rng.integers(6)), float(rng.uniform(0.75, 1.0))
    parts = [
        box((-width / 2, 0.0, 0.0), (width / 2, 0.24, 0.98), kit.white),
        _doors(kit, width - 0.03, 0.244, 0.06, 0.9, (3, 1, k)),
        box((-width / 2 - 0.01, 0.0, 0.98), (width / 2 + 0.01, 0.25, 1.0), kit.wood()),
        turned([(0.05, 1.0), (0.1, 1.05), (0.09, 1.05), (0.04, 1.01)], (0.2, 0.12), kit.brass),
    ]
    return Piece("Shoe_cabinet", "shoe cabinet", join(parts))


def nightstand(kit: Kit, rng: np.random.Generator, k: int) -> Piece:
    """Return a bedside cabinet with a lamp and books."""
    wood, feet = kit.wood(k), product((-0.22, 0.175), (0.01, 0.32))
    parts = [
        box((-0.23, 0.0, 0.1), (0.23, 0.38, 0.52), wood),
        *(box((x, y, 0.0), (x + 0.045, y + 0.045, 0.11), wood) for x, y in feet),
        _doors(kit, 0.42, 0.384, 0.13, 0.36, (2, 1, k), True),
        *table_lamp_parts(kit, -0.05, 0.16, 0.52),
        *books(kit, rng, 0.12, 0.26, 0.52),
    ]
    return Piece("Nightstand", "nightstand", join(parts))


def table_lamp_parts(kit: Kit, x: float, y: float, z: float) -> list[Triangles]:
    """Return a lamp with a ceramic foot and a lit shade."""
    foot = [(0.06, z), (0.075, z + 0.07), (0.03, z + 0.18), (0.02, z + 0.25)]
    shade = [(0.001, z + 0.22), (0.14, z + 0.22), (0.09, z + 0.42), (0.001, z + 0.42)]
    ceramic = kit.plain("foot", (92, 120, 124))
    return [turned(foot, (x, y), ceramic, 12), turned(shade, (x, y), kit.shade)]


def basket(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a laundry basket."""
    profile = [(0.001, 0.02), (0.17, 0.0), (0.21, 0.5), (0.2, 0.52), (0.19, 0.46), (0.001, 0.42)]
    return Piece("Basket", "basket", turned(profile, (0.0, 0.22), kit.wicker))


def bin_(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a waste bin."""
    return Piece("Bin", "bin", cylinder((0.0, 0.14), 0.0, 0.4, 0.13, kit.metal))


def toy_shelf(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a low children's shelf with bright boxes."""
    parts = [
        box((-0.6, 0.0, 0.0), (0.6, 0.02, 0.8), kit.white),
        *(
            box((x - 0.015, 0.0, 0.0), (x + 0.015, 0.34, 0.8), kit.white)
            for x in np.linspace(-0.585, 0.585, 4)
        ),
        *(box((-0.6, 0.0, z), (0.6, 0.34, z + 0.03), kit.white) for z in (0.02, 0.4, 0.78)),
    ]
    colors = ((216, 84, 72), (84, 148, 196), (240, 190, 72), (112, 172, 104))
    for row, z in enumerate((0.05, 0.43)):
        for column in range(3):
            color = colors[(row * 3 + column + int(rng.integers(2))) % 4]
            x, paint = -0.39 + 0.39 * column, kit.plain(f"toy {color}", color)
            parts.append(box((x - 0.16, 0.03, z), (x + 0.16, 0.31, z + 0.24), paint))
    return Piece("Toy_shelf", "shelf", join(parts))
