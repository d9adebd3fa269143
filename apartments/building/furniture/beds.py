"""Beds with their nightstands."""

from itertools import product

import numpy as np

from ...materials.kit import Kit
from ..shapes import box, join, soft_box
from .piece import Arrangement, Piece
from .storage import nightstand


def bed(kit: Kit, rng: np.random.Generator, width: float) -> Piece:
    """Return a bed: frame, headboard, mattress, duvet hanging over the sides, pillows, blanket."""
    k, style = int(rng.integers(8)), int(rng.integers(4))
    wood, linen = kit.wood(k), kit.linen(k, style)
    w, length = width / 2, 2.05
    padded = rng.random() < 0.5
    head_height = float(rng.uniform(0.95, 1.2))
    if padded:
        high = (w + 0.04, 0.11, head_height)
        headboard = soft_box((-w - 0.04, 0.0, 0.05), high, 0.05, kit.cloth(k + 1))
    else:
        headboard = box((-w - 0.03, 0.0, 0.0), (w + 0.03, 0.06, head_height), wood)
    parts = [headboard, box((-w, 0.06, 0.1), (w, length, 0.28), wood)]
    for x, y in product((-w + 0.08, w - 0.08), (0.2, length - 0.08)):
        parts.append(box((x - 0.04, y - 0.04, 0.0), (x + 0.04, y + 0.04, 0.12), wood))
    sheet, throw = kit.plain("sheet", (236, 235, 230)), kit.blanket(k + 2)
    parts += [
        soft_box((-w + 0.02, 0.09, 0.26), (w - 0.02, length - 0.02, 0.48), 0.05, sheet),
        soft_box((-w - 0.02, 0.62, 0.3), (w + 0.02, length + 0.02, 0.56), 0.06, linen, 0.012, 8),
        box((-w - 0.035, length - 0.62, 0.3), (w + 0.035, length - 0.22, 0.592), throw),
    ]
    half = min(0.32, w - 0.08)
    for x in [0.0] if width < 1.2 else [-w / 2, w / 2]:
        parts.append(soft_box((x - half, 0.14, 0.46), (x + half, 0.56, 0.62), 0.07, linen, 0.03))
        parts.append(soft_box((x - 0.2, 0.42, 0.52), (x + 0.2, 0.6, 0.78), 0.07, kit.cloth(k + 2)))
    return Piece("Bed", "bed", join(parts))


def bed_set(kit: Kit, rng: np.random.Generator, width: float, stands: int) -> Arrangement:
    """Return a bed with `stands` (0–2) nightstands beside its head."""
    pieces = [bed(kit, rng, width)]
    k = int(rng.integers(3))
    for side in (-1, 1)[:stands]:
        pieces.append(nightstand(kit, rng, k).moved(0.0, side * (width / 2 + 0.3), 0.0))
    return Arrangement(tuple(pieces), 0.55)
