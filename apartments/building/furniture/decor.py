"""Plants, lamps, rugs, pictures, curtains, radiators."""

from itertools import pairwise

import numpy as np

from ...materials import pictures
from ...materials.fabrics import rug as rug_image
from ...materials.kit import Kit
from ..shapes import box, cylinder, ellipsoid, join, quad, rod, turned
from .piece import Piece


def plant(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a pot plant: trunk, a crown of leafy lumps."""
    height = float(rng.uniform(0.9, 1.6))
    color = [(206, 200, 190), (160, 92, 66), (70, 76, 84)][int(rng.integers(3))]
    profile = [(0.11, 0.0), (0.15, 0.28), (0.16, 0.3), (0.14, 0.3), (0.13, 0.26), (0.001, 0.26)]
    pot = turned(profile, (0.0, 0.24), kit.plain(f"pot {color}", color))
    parts = [pot, cylinder((0.0, 0.24), 0.25, 0.7 * height, 0.03, kit.wood(1), 8)]
    for _ in range(int(rng.integers(34, 48))):
        a, r = rng.uniform(0, 2 * np.pi), 0.26 * np.sqrt(rng.random()) * (0.75 + 0.25 * height)
        z = height * (1.0 - rng.uniform(0.0, 0.55) * (1.1 - r / 0.3))
        size = rng.uniform(0.035, 0.075, 3) * (1.0, 1.0, 0.7)
        center = (0.8 * r * np.cos(a), 0.24 + 0.8 * r * np.sin(a), z)
        parts.append(ellipsoid(center, size, kit.foliage, 4))
    return Piece("Plant", "plant", join(parts))


def floor_lamp(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a standing lamp."""
    parts = [
        cylinder((0.0, 0.2), 0.0, 0.035, 0.15, kit.black, 18),
        cylinder((0.0, 0.2), 0.03, 1.35, 0.024, kit.black, 8),
        turned([(0.001, 1.28), (0.2, 1.28), (0.13, 1.58), (0.001, 1.58)], (0.0, 0.2), kit.shade),
    ]
    return Piece("Floor_lamp", "floor lamp", join(parts))


def pendant(kit: Kit, rng: np.random.Generator, ceiling_m: float) -> Piece:
    """Return a ceiling lamp, high enough to walk under."""
    z = ceiling_m - float(rng.uniform(0.22, 0.3))
    if rng.random() < 0.5:
        parts = [cylinder((0, 0), z - 0.12, z + 0.06, 0.24, kit.shade, 20)]
        parts.append(cylinder((0, 0), z + 0.05, ceiling_m, 0.02, kit.black, 6))
    else:
        parts = [
            cylinder((0, 0), ceiling_m - 0.09, ceiling_m, 0.22, kit.shade, 20),
            cylinder((0, 0), ceiling_m - 0.03, ceiling_m, 0.24, kit.brass, 20),
        ]
    return Piece("Ceiling_lamp", "ceiling lamp", join(parts))


def rug(kit: Kit, rng: np.random.Generator, width: float, depth: float) -> Piece:
    """Return a flat rug centred on the origin."""
    start = int(rng.integers(8))
    colors = [kit.cloth_color(start + k) for k in (0, 2, 5)]
    image = kit.palette.unique("rug", rug_image, (width, depth), colors)
    w, d, back = width / 2, depth / 2, kit.plain("rug back", colors[0])
    top = quad((-w, -d, 0.008), (width, 0, 0), (0, depth, 0), image)
    return Piece("Rug", "rug", join([box((-w, -d, 0.0), (w, d, 0.007), back), top]))


def picture(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a framed picture; its back is at y = 0, its centre at height 0."""
    w, h = rng.uniform(0.2, 0.45), rng.uniform(0.2, 0.36)
    frame = kit.black if rng.random() < 0.5 else kit.wood(int(rng.integers(3)))
    image = kit.palette.unique("picture", pictures.painting, (2 * w, 2 * h))
    parts = [
        box((-w - 0.03, 0.0, -h - 0.03), (w + 0.03, 0.022, h + 0.03), frame),
        quad((w, 0.024, -h), (-2 * w, 0, 0), (0, 0, 2 * h), image),
    ]
    return Piece("Picture", "picture", join(parts))


def clock(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a wall clock, centred at height 0."""
    face = kit.palette.unique("clock", pictures.clock, (0.34, 0.34))
    parts = [
        box((-0.18, 0.0, -0.18), (0.18, 0.03, 0.18), kit.black),
        quad((0.17, 0.032, -0.17), (-0.34, 0, 0), (0, 0, 0.34), face),
    ]
    return Piece("Clock", "clock", join(parts))


def mirror(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a tall mirror, centred at height 0."""
    glass = kit.palette.unique("mirror", pictures.mirror, (0.5, 1.3))
    parts = [
        box((-0.28, 0.0, -0.68), (0.28, 0.025, 0.68), kit.wood()),
        quad((0.25, 0.028, -0.65), (-0.5, 0, 0), (0, 0, 1.3), glass),
    ]
    return Piece("Mirror", "mirror", join(parts))


def coat_rack(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return the hooks with coats, centred at height 0."""
    parts = [box((-0.5, 0.0, -0.06), (0.5, 0.025, 0.06), kit.wood())]
    for k, x in enumerate(np.linspace(-0.4, 0.4, 5)):
        parts.append(rod((x, 0.02, 0.0), (x, 0.08, 0.02), 0.025, kit.black))
        if rng.random() < 0.65:
            half = float(rng.uniform(0.6, 0.95)) / 2
            parts.append(ellipsoid((x, 0.08, -half), (0.11, 0.065, half), kit.cloth(k + 1)))
    return Piece("Coat_rack", "coat rack", join(parts))


def curtain(kit: Kit, width: float, bottom: float, top: float, k: int) -> Piece:
    """Return a gathered curtain centred on x = 0, 5–11 cm before the wall."""
    x = np.linspace(-width / 2, width / 2, 33)
    y = 0.075 + 0.03 * np.cos(np.linspace(0, 2 * np.pi * max(round(width / 0.12), 2), 33))
    cloth, up = kit.cloth(k), (0, 0, top - bottom)
    parts = [
        quad((x1, y1, bottom), (x0 - x1, y0 - y1, 0.0), up, cloth)
        for (x0, y0), (x1, y1) in pairwise(zip(x, y, strict=True))
    ]
    return Piece("Curtain", "curtain", join(parts))


def curtain_rod(kit: Kit, width: float, z: float) -> Piece:
    """Return the rod above a window."""
    shape = rod((-width / 2, 0.075, z), (width / 2, 0.075, z), 0.035, kit.brass)
    return Piece("Curtain_rod", "curtain rod", shape)


def radiator(kit: Kit, width: float, top: float) -> Piece:
    """Return a ribbed radiator under a window."""
    count = max(int(width / 0.09), 3)
    xs = np.linspace(-width / 2, width / 2, count + 1)
    parts = [
        box((x0 + 0.012, 0.03, 0.12), (x1 - 0.012, 0.13, top), kit.white) for x0, x1 in pairwise(xs)
    ]
    parts.append(box((-width / 2, 0.05, 0.14), (width / 2, 0.11, top - 0.02), kit.white))
    return Piece("Radiator", "radiator", join(parts))
