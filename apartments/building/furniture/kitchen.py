"""Kitchen: counter with sink and stove, wall cupboards, refrigerator."""

from dataclasses import replace

import numpy as np

from ...materials import pictures
from ...materials.floors import tiles
from ...materials.kit import Kit
from ..shapes import Triangles, box, cylinder, join, quad, turned
from .piece import Arrangement, Piece
from .tables import bowl

_FRIDGE_M = 0.66


def _face(x0: float, x1: float, y: float, z0: float, z1: float, material: int) -> Triangles:
    return quad((x1, y, z0), (x0 - x1, 0.0, 0.0), (0.0, 0.0, z1 - z0), material)


def counter(
    kit: Kit, rng: np.random.Generator, width: float, upper: bool, fridge: bool = True
) -> Arrangement:
    """Return a kitchen run of `width`: refrigerator, cupboards, sink, stove, hood."""
    k = 0
    w = width / 2
    flip = -1 if rng.random() < 0.5 else 1
    body, stone = kit.front_color(k), kit.stone
    base0, base1 = (-w + _FRIDGE_M + 0.02 if fridge else -w), w
    cabinets = base1 - base0
    stove0 = base0 + cabinets * 0.62
    sink0 = base0 + cabinets * 0.18
    parts = [
        box((base0, 0.0, 0.1), (base1, 0.58, 0.86), body),
        box((base0, 0.0, 0.0), (base1, 0.52, 0.1), kit.black),
        box((base0 - 0.005, 0.0, 0.86), (base1 + 0.01, 0.62, 0.9), stone),
        _face(base0, base1, 0.02, 0.9, 1.42, _splash(kit)),
    ]
    for x0, x1 in ((base0, stove0), (stove0 + 0.6, base1)):
        if x1 - x0 > 0.2:
            leaves = max(round((x1 - x0) / 0.5), 1)
            front = kit.front(x1 - x0, 0.74, 1, leaves, k)
            parts.append(_face(x0, x1, 0.585, 0.11, 0.85, front))
    oven = kit.palette.unique("oven", pictures.oven, (0.6, 0.72))
    parts.append(_face(stove0, stove0 + 0.6, 0.587, 0.13, 0.85, oven))
    parts.append(box((stove0 + 0.03, 0.06, 0.9), (stove0 + 0.57, 0.55, 0.912), kit.black))
    ring = kit.plain("ring", (74, 30, 28))
    for x, y, r in ((0.17, 0.18, 0.09), (0.43, 0.18, 0.07), (0.17, 0.42, 0.07), (0.43, 0.42, 0.09)):
        parts.append(cylinder((stove0 + x, y), 0.912, 0.918, r, ring, 16))
    pot = [(0.001, 0.93), (0.1, 0.92), (0.105, 1.04), (0.095, 1.04)]
    parts.append(turned(pot, (stove0 + 0.17, 0.18), kit.metal))
    # The sink: a rim around a basin that is set on the worktop's cut-out.
    basin = kit.plain("basin", (112, 116, 120))
    parts += [
        box((sink0, 0.1, 0.895), (sink0 + 0.56, 0.53, 0.915), kit.metal),
        box((sink0 + 0.05, 0.14, 0.905), (sink0 + 0.5, 0.48, 0.918), basin),
        cylinder((sink0 + 0.28, 0.07), 0.9, 1.18, 0.022, kit.metal, 8),
        box((sink0 + 0.262, 0.07, 1.15), (sink0 + 0.298, 0.28, 1.18), kit.metal),
    ]
    parts += bowl(kit, base0 + 0.1 * cabinets, 0.32, 0.9, k)
    if base1 - stove0 - 0.6 > 0.3:
        x = stove0 + 0.75
        parts.append(box((x, 0.06, 0.9), (x + 0.12, 0.22, 1.14), kit.black))
        parts.append(cylinder((x + 0.25, 0.15), 0.9, 1.08, 0.055, kit.brass, 12))
    pieces = [Piece("Kitchen_counter", "kitchen counter", join(parts))]
    if fridge:
        pieces.append(refrigerator(kit).moved(x_m=-w + _FRIDGE_M / 2))
    if upper:
        cupboards = []
        for x0, x1 in ((base0, stove0), (stove0 + 0.6, base1)):
            if x1 - x0 > 0.25:
                leaves = max(round((x1 - x0) / 0.45), 1)
                doors = kit.front(x1 - x0, 0.65, 1, leaves, k)
                cupboards.append(box((x0, 0.0, 1.45), (x1, 0.33, 2.12), body))
                cupboards.append(_face(x0, x1, 0.334, 1.46, 2.11, doors))
        pieces.append(Piece("Wall_cupboard", "wall cupboard", join(cupboards)))
        hood = [
            box((stove0 + 0.02, 0.0, 1.6), (stove0 + 0.58, 0.48, 1.68), kit.metal),
            box((stove0 + 0.18, 0.0, 1.66), (stove0 + 0.42, 0.26, 2.3), kit.metal),
        ]
        pieces.append(Piece("Range_hood", "range hood", join(hood)))
    if flip < 0:
        pieces = [replace(p, shape=p.shape.scaled((-1.0, 1.0, 1.0))) for p in pieces]
    return Arrangement(tuple(pieces), 0.75)


def refrigerator(kit: Kit) -> Piece:
    """Return a tall refrigerator."""
    w = _FRIDGE_M / 2
    shape = [
        box((-w, 0.0, 0.02), (w, 0.62, 1.9), kit.metal),
        _face(-w, w, 0.625, 0.04, 1.9, kit.palette.unique("fridge", _fridge, (2 * w, 1.86))),
        box((-w + 0.02, 0.02, 0.0), (w - 0.02, 0.58, 0.03), kit.black),
    ]
    return Piece("Refrigerator", "refrigerator", join(shape))


def _splash(kit: Kit) -> int:
    pale = tuple(int(170 + 0.33 * c) for c in kit.cloth_color(1))
    joints = {"grout": (232, 230, 226), "offset": True, "grout_px": 1.3}
    return kit.palette.get("splash", tiles, (0.9, 0.75), (10, 6), pale, **joints)


def _fridge(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    base = (214, 216, 217) if rng.random() < 0.6 else (148, 151, 154)
    image = pictures.front(rng, shape, base, 1, 1).astype(np.float32)
    height, width = shape
    cut = int(0.36 * height)
    image[cut : cut + 3] *= 0.4
    for top, low in ((int(0.12 * height), cut - 20), (cut + 24, int(0.75 * height))):
        image[top:low, 10:15] = (96, 98, 100)
    for _ in range(5):  # Magnets and notes.
        y, x = int(rng.uniform(0.45, 0.62) * height), int(rng.uniform(0.3, 0.8) * width)
        h, w = rng.integers(8, 22, 2)
        image[y : y + h, x : x + w] = rng.uniform(90, 240, 3)
    return image.clip(0, 255).astype(np.uint8)
