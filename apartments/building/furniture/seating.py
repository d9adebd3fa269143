"""Sofas and chairs."""

from itertools import product

import numpy as np

from ...materials.kit import Kit
from ..shapes import Triangles, box, cylinder, join, rod, soft_box
from .piece import Piece


def _legs(
    x: float, y0: float, y1: float, height: float, side: float, material: int
) -> list[Triangles]:
    h, places = side / 2, product((-x, x), (y0, y1))
    return [box((a - h, y - h, 0.0), (a + h, y + h, height), material) for a, y in places]


def sofa(kit: Kit, rng: np.random.Generator, seats: int = 3) -> Piece:
    """Return a sofa with arms, seat and back cushions, throw pillows and a blanket."""
    k = int(rng.integers(4))
    cloth, arm = kit.cloth(k), float(rng.uniform(0.16, 0.24))
    seat = float(rng.uniform(0.58, 0.66))
    width, depth = seats * seat + 2 * arm, float(rng.uniform(0.86, 0.95))
    w = width / 2
    parts = [
        *_legs(w - 0.1, 0.1, depth - 0.1, 0.1, 0.06, kit.wood()),
        soft_box((-w + arm, 0.05, 0.1), (w - arm, depth - 0.03, 0.3), 0.03, cloth),
        soft_box((-w, 0.0, 0.08), (w, 0.22, 0.82), 0.07, cloth),
        soft_box((-w, 0.0, 0.08), (-w + arm, depth, 0.6), 0.06, cloth),
        soft_box((w - arm, 0.0, 0.08), (w, depth, 0.6), 0.06, cloth),
    ]
    for s in range(seats):
        x0 = -w + arm + s * seat
        parts.append(soft_box((x0, 0.2, 0.28), (x0 + seat, depth, 0.46), 0.06, cloth, 0.03))
        parts.append(soft_box((x0 + 0.01, 0.16, 0.44), (x0 + seat - 0.01, 0.38, 0.88), 0.09, cloth))
    for side in (-1, 1):
        pillow = soft_box((-0.22, -0.07, -0.21), (0.22, 0.07, 0.21), 0.07, kit.cloth(k + 2 + side))
        x = side * (w - arm - 0.26)
        parts.append(pillow.tilted(0.35, (0, 0, 0)).moved(side * 0.25, (x, 0.45, 0.67)))
    if rng.random() < 0.6:
        x, throw = float(rng.uniform(-0.5, 0.3)) * seat, kit.blanket(k + 1)
        parts.append(box((x, depth - 0.34, 0.475), (x + 0.5, depth + 0.012, 0.5), throw))
        parts.append(box((x, depth - 0.005, 0.14), (x + 0.5, depth + 0.02, 0.5), throw))
    return Piece("Sofa", "sofa", join(parts))


def armchair(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a padded armchair on wooden legs."""
    k = int(rng.integers(4, 8))
    cloth = kit.cloth(k)
    w, depth = 0.39, 0.82
    parts = [
        *_legs(w - 0.08, 0.1, depth - 0.1, 0.16, 0.05, kit.wood(1)),
        soft_box((-w + 0.1, 0.05, 0.14), (w - 0.1, depth - 0.02, 0.44), 0.07, cloth, 0.03),
        soft_box((-w + 0.06, 0.0, 0.14), (w - 0.06, 0.2, 0.9), 0.09, cloth),
        soft_box((-w, 0.02, 0.14), (-w + 0.14, depth - 0.05, 0.62), 0.06, cloth),
        soft_box((w - 0.14, 0.02, 0.14), (w, depth - 0.05, 0.62), 0.06, cloth),
        soft_box((-0.2, 0.2, 0.46), (0.2, 0.33, 0.8), 0.06, kit.cloth(k + 3)),
    ]
    return Piece("Armchair", "armchair", join(parts))


def chair(kit: Kit, rng: np.random.Generator, k: int = 0) -> Piece:
    """Return a dining chair; its back is towards −y like every back."""
    wood = kit.wood(k)
    w, depth, seat = 0.215, 0.46, 0.45
    parts = [
        *_legs(w - 0.025, depth - 0.03, depth - 0.03, seat, 0.045, wood)[::2],
        soft_box((-w, 0.03, seat - 0.03), (w, depth, seat + 0.035), 0.03, kit.cloth(k + 4)),
    ]
    for side in (-1, 1):
        x = side * (w - 0.025)
        parts.append(rod((x, 0.06, 0.0), (x, 0.06, seat), 0.045, wood))
        parts.append(rod((x, 0.06, seat - 0.02), (x, 0.0, 0.92), 0.045, wood))
    for z in (0.6, 0.74, 0.88):
        y = 0.05 - 0.05 * (z - seat) / 0.47
        parts.append(box((-w + 0.02, y - 0.02, z - 0.045), (w - 0.02, y + 0.015, z + 0.03), wood))
    return Piece("Chair", "chair", join(parts))


def office_chair(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a swivel chair on five feet."""
    cloth = kit.cloth(int(rng.integers(8)))
    parts = [cylinder((0.0, 0.3), 0.06, 0.44, 0.035, kit.metal)]
    for k in range(5):
        a = 2 * np.pi * k / 5 + 0.3
        tip = (0.28 * np.cos(a), 0.3 + 0.28 * np.sin(a), 0.06)
        parts.append(rod((0.0, 0.3, 0.08), tip, 0.05, kit.black))
        parts.append(cylinder(tip[:2], 0.0, 0.07, 0.03, kit.black, 8))
    parts += [
        soft_box((-0.25, 0.06, 0.43), (0.25, 0.56, 0.53), 0.05, cloth, 0.02),
        rod((0.0, 0.12, 0.45), (0.0, 0.05, 0.7), 0.05, kit.black),
        soft_box((-0.23, 0.0, 0.6), (0.23, 0.09, 1.08), 0.04, cloth),
    ]
    return Piece("Office_chair", "office chair", join(parts))


def pouf(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a round upholstered stool."""
    cloth = kit.cloth(int(rng.integers(8)))
    shape = soft_box((-0.25, 0.0, 0.0), (0.25, 0.5, 0.4), 0.14, cloth, 0.03, steps=8)
    return Piece("Pouf", "pouf", shape)


def bench(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a hall bench with a cushion, shallow enough for a corridor."""
    wood = kit.wood()
    parts = [
        *_legs(0.42, 0.05, 0.27, 0.42, 0.05, wood),
        box((-0.48, 0.01, 0.4), (0.48, 0.32, 0.44), wood),
        soft_box((-0.46, 0.02, 0.43), (0.46, 0.31, 0.5), 0.03, kit.cloth(5)),
        box((-0.44, 0.03, 0.14), (0.44, 0.29, 0.17), wood),
    ]
    return Piece("Bench", "bench", join(parts))
