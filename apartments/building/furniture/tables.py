"""Tables and what stands on them."""

from itertools import product

import numpy as np

from ...materials import pictures
from ...materials.kit import Kit
from ..shapes import Triangles, box, cylinder, ellipsoid, join, quad, turned
from .piece import Arrangement, Piece
from .seating import chair, office_chair


def _frame(
    w: float, y0: float, y1: float, height: float, top: float, wood: int, leg: float
) -> list[Triangles]:
    inset = leg / 2 + 0.04
    legs = [
        box((x - leg / 2, y - leg / 2, 0.0), (x + leg / 2, y + leg / 2, height - top), wood)
        for x, y in product((-w + inset, w - inset), (y0 + inset, y1 - inset))
    ]
    return [box((-w, y0, height - top), (w, y1, height), wood), *legs]


def bowl(kit: Kit, x: float, y: float, z: float, k: int) -> list[Triangles]:
    """Return a fruit bowl."""
    rim = [(0.001, z + 0.01), (0.06, z), (0.13, z + 0.07), (0.12, z + 0.075), (0.05, z + 0.02)]
    parts = [turned(rim, (x, y), kit.plain("glaze", (196, 202, 204)))]
    colors = ((196, 64, 48), (220, 150, 40), (120, 160, 60))
    for j, a in enumerate((0.3, 2.4, 4.4), k):
        skin = kit.plain(f"fruit {j % 3}", colors[j % 3])
        center = (x + 0.045 * np.cos(a), y + 0.045 * np.sin(a), z + 0.07)
        parts.append(ellipsoid(center, (0.04, 0.04, 0.04), skin, 5))
    return parts


def vase(kit: Kit, x: float, y: float, z: float) -> list[Triangles]:
    """Return a vase with a bunch of flowers."""
    profile = [(0.04, z), (0.07, z + 0.08), (0.035, z + 0.18), (0.045, z + 0.2)]
    body = turned(profile, (x, y), kit.plain("vase", (70, 100, 130)))
    leaf = kit.foliage
    parts = [body, cylinder((x, y), z + 0.18, z + 0.3, 0.03, leaf, 6)]
    colors = {"bloom": (222, 120, 130), "bloom 2": (236, 200, 96)}
    petals = [leaf, *(kit.plain(name, color) for name, color in colors.items())]
    for a, material in zip((0.0, 2.1, 4.2), petals, strict=True):
        center = (x + 0.05 * np.cos(a), y + 0.05 * np.sin(a), z + 0.3 + 0.03 * np.sin(2 * a))
        parts.append(ellipsoid(center, (0.05, 0.05, 0.05), material, 5))
    return parts


def books(kit: Kit, rng: np.random.Generator, x: float, y: float, z: float) -> list[Triangles]:
    """Return a few books lying on each other."""
    parts = []
    for k in range(int(rng.integers(2, 5))):
        r, g, b = (int(c) for c in rng.integers(40, 210, 3))
        color = (r, g, b)
        w, d = rng.uniform(0.1, 0.13), rng.uniform(0.07, 0.1)
        cover = box((-w, -d, 0.0), (w, d, 0.028), kit.plain(f"book {color}", color))
        parts.append(cover.moved(float(rng.normal(0, 0.2)), (x, y, z + 0.028 * k)))
    return parts


def dining_set(kit: Kit, rng: np.random.Generator, seats: int) -> Arrangement:
    """Return a table in the middle with chairs around it."""
    k = int(rng.integers(3))
    width, depth = (1.65, 0.9) if seats == 6 else (1.2, 0.8)
    w, d = width / 2, depth / 2
    if seats == 2:
        w, d = 0.4, 0.4
    if seats == 4 and rng.random() < 0.4:
        w = d = 0.52
        table = [
            cylinder((0, 0), 0.71, 0.75, 0.55, kit.wood(k), 28),
            turned([(0.3, 0.0), (0.28, 0.04), (0.06, 0.1), (0.06, 0.71)], (0, 0), kit.wood(k)),
        ]
    else:
        table = _frame(w, -d, d, 0.75, 0.04, kit.wood(k), 0.06)
    table += bowl(kit, 0.0, 0.0, 0.75, k) if rng.random() < 0.5 else vase(kit, 0.0, 0.0, 0.75)
    tuck = float(rng.uniform(0.12, 0.24))
    pieces = [Piece("Dining_table", "dining table", join(table))]
    xs = [-0.5, 0.5] if seats == 6 else ([0.0] if w == d else [-0.3, 0.3])
    places = [(x, d + tuck, np.pi) for x in xs] + [(x, -d - tuck, 0.0) for x in xs]
    if seats == 6 or w == d:
        places += [(w + tuck, 0.0, np.pi / 2), (-w - tuck, 0.0, -np.pi / 2)]
    for x, y, yaw in places[:seats]:
        seat = chair(kit, rng, k).moved(yaw + float(rng.normal(0, 0.1)))
        middle = seat.shape.bounds().mean(0)
        pieces.append(seat.moved(0.0, x - middle[0], y - middle[1]))
    return Arrangement(tuple(pieces), 0.0, wall=False)


def coffee_table(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a low table with books and a bowl, centred on the origin."""
    k = int(rng.integers(3))
    if rng.random() < 0.35:
        parts = [cylinder((0, 0), 0.37, 0.41, 0.42, kit.wood(k), 28)]
        for a in (0.5, 2.6, 4.7):
            foot = (0.27 * np.cos(a), 0.27 * np.sin(a))
            parts.append(cylinder(foot, 0.0, 0.38, 0.028, kit.black, 8))
    else:
        parts = _frame(0.52, -0.29, 0.29, 0.42, 0.04, kit.wood(k), 0.055)
        parts.append(box((-0.44, -0.22, 0.14), (0.44, 0.22, 0.165), kit.wood(k)))
    parts += books(kit, rng, -0.2, 0.03, 0.42)
    parts += bowl(kit, 0.2, 0.0, 0.42, k)
    return Piece("Coffee_table", "coffee table", join(parts))


def desk_set(kit: Kit, rng: np.random.Generator) -> Arrangement:
    """Return a desk at the wall with screen, keyboard, lamp, books, and a swivel chair."""
    k = int(rng.integers(3))
    w = float(rng.uniform(0.6, 0.75))
    wood = kit.wood(k)
    drawers = kit.front(0.4, 0.62, 3, 1, k, wood=True)
    parts = [
        box((-w, 0.0, 0.71), (w, 0.65, 0.75), wood),
        box((-w, 0.02, 0.0), (-w + 0.04, 0.63, 0.71), wood),
        box((w - 0.4, 0.03, 0.06), (w, 0.58, 0.71), wood),
        quad((w, 0.585, 0.08), (-0.4, 0, 0), (0, 0, 0.62), drawers),
    ]
    monitor = kit.palette.unique("screen", pictures.screen, (0.56, 0.34))
    parts += [
        box((-0.3, 0.12, 0.86), (0.3, 0.15, 1.22), kit.black),
        quad((0.28, 0.153, 0.87), (-0.56, 0, 0), (0, 0, 0.34), monitor),
        box((-0.03, 0.08, 0.75), (0.03, 0.12, 1.0), kit.black),
        box((-0.12, 0.06, 0.75), (0.12, 0.26, 0.77), kit.black),
        box((-0.22, 0.36, 0.75), (0.22, 0.5, 0.775), kit.plain("keys", (70, 72, 76))),
    ]
    parts += books(kit, rng, w - 0.2, 0.25, 0.75)
    lamp, shade = (-w + 0.17, 0.2), [(0.001, 1.04), (0.1, 1.04), (0.055, 1.2), (0.001, 1.2)]
    parts += [
        cylinder(lamp, 0.75, 0.78, 0.08, kit.black, 12),
        cylinder(lamp, 0.78, 1.06, 0.02, kit.black, 8),
        turned(shade, lamp, kit.shade),
    ]
    seat = office_chair(kit, rng).moved(np.pi + float(rng.normal(0, 0.4)), -0.12, 1.0)
    return Arrangement((Piece("Desk", "desk", join(parts)), seat), 0.25, on_window=True)
