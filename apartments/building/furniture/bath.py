"""Bathroom fittings."""

import numpy as np

from ...materials import pictures
from ...materials.kit import Kit
from ..shapes import box, cylinder, ellipsoid, join, quad, rod, soft_box, turned
from .piece import Piece


def bathtub(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a built-in tub with water in it and a tap."""
    white, w, d, h = kit.ceramic, 0.84, 0.74, 0.56
    parts = [
        box((-w, 0.0, 0.0), (w, 0.05, h), white),
        box((-w, d - 0.06, 0.0), (w, d, h), white),
        box((-w, 0.0, 0.0), (-w + 0.07, d, h), white),
        box((w - 0.07, 0.0, 0.0), (w, d, h), white),
        box((-w, 0.0, 0.1), (w, d, 0.22), kit.plain("tub floor", (226, 230, 232))),
        cylinder((w - 0.12, 0.37), h - 0.02, h + 0.14, 0.025, kit.metal, 8),
        box((w - 0.26, 0.345, h + 0.11), (w - 0.1, 0.395, h + 0.15), kit.metal),
        box((-0.3, d - 0.065, h - 0.22), (0.2, d + 0.012, h + 0.012), kit.cloth(3)),
    ]
    return Piece("Bathtub", "bathtub", join(parts))


def toilet(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a toilet with cistern, bowl and lid."""
    white = kit.ceramic
    profile = [(0.13, 0.0), (0.12, 0.16), (0.19, 0.36), (0.2, 0.41), (0.001, 0.42)]
    bowl = turned(profile, (0.0, 0.0), white).scaled((0.95, 1.25, 1.0))
    parts = [
        soft_box((-0.2, 0.0, 0.38), (0.2, 0.18, 0.8), 0.04, white),
        box((-0.11, 0.06, 0.0), (0.11, 0.3, 0.4), white),
        bowl.moved(0.0, (0.0, 0.42, 0.0)),
        soft_box((-0.19, 0.18, 0.4), (0.19, 0.66, 0.46), 0.03, white),
        cylinder((0.0, 0.09), 0.8, 0.815, 0.03, kit.metal, 10),
    ]
    return Piece("Toilet", "toilet", join(parts))


def washbasin(kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a basin on a vanity, and the mirror above it."""
    k, w = int(rng.integers(1, 6)), float(rng.uniform(0.3, 0.45))
    vanity = [
        box((-w, 0.0, 0.12), (w, 0.44, 0.78), kit.front_color(k)),
        quad((w, 0.445, 0.14), (-2 * w, 0, 0), (0, 0, 0.62), kit.front(2 * w, 0.62, 1, 2, k)),
        box((-w + 0.03, 0.03, 0.0), (w - 0.03, 0.38, 0.12), kit.black),
        soft_box((-w - 0.02, 0.0, 0.77), (w + 0.02, 0.48, 0.9), 0.04, kit.ceramic),
        ellipsoid(
            (0.0, 0.26, 0.895), (0.2, 0.13, 0.012), kit.plain("basin hollow", (196, 202, 206))
        ),
        cylinder((0.0, 0.07), 0.88, 1.04, 0.022, kit.metal, 8),
        box((-0.018, 0.06, 1.01), (0.018, 0.2, 1.04), kit.metal),
        cylinder((w - 0.08, 0.1), 0.89, 1.03, 0.03, kit.plain("soap", (232, 196, 120)), 8),
    ]
    glass = kit.palette.unique("mirror", pictures.mirror, (1.8 * w, 0.8))
    mirror = [
        box((-0.9 * w - 0.02, 0.0, 1.2), (0.9 * w + 0.02, 0.03, 2.04), kit.metal),
        quad((0.9 * w, 0.033, 1.22), (-1.8 * w, 0, 0), (0, 0, 0.8), glass),
    ]
    return [Piece("Washbasin", "washbasin", join(vanity)), Piece("Mirror", "mirror", join(mirror))]


def washing_machine(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a washing machine with towels on it."""
    face = kit.palette.unique("washer", pictures.washer, (0.6, 0.84))
    parts = [
        box((-0.3, 0.02, 0.02), (0.3, 0.58, 0.86), kit.white),
        quad((0.3, 0.585, 0.02), (-0.6, 0, 0), (0, 0, 0.84), face),
    ]
    for k in range(3):
        low, high = (-0.22, 0.1, 0.86 + 0.06 * k), (0.16, 0.42, 0.92 + 0.06 * k)
        parts.append(soft_box(low, high, 0.02, kit.cloth(k + 2)))
    return Piece("Washing_machine", "washing machine", join(parts))


def towel_rail(kit: Kit, rng: np.random.Generator) -> Piece:
    """Return a ladder radiator with a towel."""
    parts = [rod((x, 0.06, 0.5), (x, 0.06, 1.6), 0.04, kit.white) for x in (-0.25, 0.25)]
    parts += [
        rod((-0.25, 0.06, z), (0.25, 0.06, z), 0.035, kit.white)
        for z in (0.55, 0.65, 0.75, 0.95, 1.05, 1.25, 1.35, 1.55)
    ]
    parts.append(box((-0.2, 0.05, 0.75), (0.16, 0.1, 1.28), kit.cloth(4)))
    parts.append(box((-0.25, 0.0, 0.6), (-0.22, 0.06, 0.63), kit.white))
    return Piece("Towel_rail", "towel rail", join(parts))
