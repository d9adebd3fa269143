"""Decoration of walls and ceilings: pictures, mirrors, curtains, radiators, lamps."""

import numpy as np

from ..materials.kit import Kit
from .furniture import decor
from .furniture.piece import Piece, alone
from .plan import SIDES, Opening
from .space import RoomSpace, at_wall, overlaps


def _highest(space: RoomSpace, zone: np.ndarray) -> float:
    """Return the top of the highest furniture over a zone; 0 if none."""
    return max((top for flat, top in space.tops if overlaps(flat, zone)), default=0.0)


def ceiling_lamps(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return one lamp in the middle, several in long rooms, rows of them in open-plan offices."""
    size = space.room.size_m
    long = int(np.argmax(size))
    count = max(round(float(size[long]) / 3.8), 1)
    rows = max(round(float(size[1 - long]) / 4.5), 1) if space.room.kind == "office" else 1
    lit = _lit_bounds(space)
    wide = [b for b in space.plan.blocks_of(space.index) if b.stairs and b.stairs.shape == "L"]
    along = (lit if wide else space.bounds)[:, long]
    pieces = []
    for k in range(count * rows):
        share = (k // count + 0.5) / rows
        at = (1 - share) * lit[0] + share * lit[1]
        at[long] = along[0] + (along[1] - along[0]) * (k % count + 0.5) / count
        lamp = decor.pendant(kit, rng, space.plan.ceiling_m)
        pieces.append(lamp.moved(0.0, float(at[0]), float(at[1])))
    return pieces


def _lit_bounds(space: RoomSpace) -> np.ndarray:
    """Return (2, 2) the part of a room that its lamps hang over: beside the stairs, not in them."""
    bounds = space.bounds.copy()
    for block in space.plan.blocks_of(space.index, "stairs", "void"):
        across, wall = 1 - block.front[0], block.stairs.wall_sign if block.stairs else -1
        bounds[int(wall > 0), across] = block.rect()[int(wall < 0), across]
    return bounds


def windows(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the radiators beneath and curtains beside the room's windows, where there is space."""
    pieces: list[Piece] = []
    k, kind = int(rng.integers(8)), space.room.kind
    for hole in (o for o in space.plan.openings if o.kind == "window" and o.room == space.index):
        width = hole.end_m - hole.start_m
        if hole.bottom_m > 0.6 and kind != "kitchen":
            heater = decor.radiator(kit, min(width * 0.8, 1.2), min(0.62, hole.bottom_m - 0.15))
            item = alone(heater, 0.0, on_window=True)
            placed = at_wall(space, item, hole.axis, hole.sign, (hole.start_m + hole.end_m) / 2)
            if space.fits(placed):
                space.place(placed)
                pieces += placed.pieces
        if kind not in ("bathroom", "kitchen", "hallway"):
            pieces += _curtains(space, kit, hole, k)
    return pieces


def _curtains(space: RoomSpace, kit: Kit, hole: Opening, k: int) -> list[Piece]:
    pieces: list[Piece] = []
    gather, top = 0.34, min(hole.top_m + 0.12, space.plan.ceiling_m - 0.06)
    start, end = space.room.span(hole.axis)
    for s0 in (hole.start_m - 0.24, hole.end_m - 0.1):
        s1 = s0 + gather
        zone = space.room.strip(hole.axis, hole.sign, (s0, s1), 0.13)
        at_door = any(overlaps(zone, z) for z in space.reserved[: len(space.entrances)])
        if s0 < start + 0.02 or s1 > end - 0.02 or at_door:
            continue
        under = _highest(space, zone)
        bottom = 0.03 if under == 0.0 else max(under + 0.03, hole.bottom_m - 0.1)
        if bottom > hole.bottom_m + 0.2:
            continue
        cloth = alone(decor.curtain(kit, gather, bottom, top, k), 0.0, on_window=True)
        placed = at_wall(space, cloth, hole.axis, hole.sign, (s0 + s1) / 2)
        if bottom > 0.1 or space.passable(placed.footprints()):
            space.place(placed)
            pieces += placed.pieces
    if pieces:
        middle = (hole.start_m + hole.end_m) / 2
        width = min(hole.end_m - hole.start_m + 0.6, 2 * min(middle - start, end - middle) - 0.02)
        rail = alone(decor.curtain_rod(kit, width, top), 0.0)
        pieces += at_wall(space, rail, hole.axis, hole.sign, middle).pieces
    return pieces


def wall_hangings(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the pictures and the like on free stretches of wall, above low furniture."""
    pieces: list[Piece] = []
    occupied: list[np.ndarray] = []
    kind = space.room.kind
    if kind == "hallway":
        makers = [decor.coat_rack, decor.mirror, *[decor.picture] * 4]
    elif kind == "bathroom":
        makers = [decor.picture]
    else:
        makers = [decor.clock] if rng.random() < 0.5 else []
        makers += [decor.mirror] if kind == "bedroom" else []
        makers += [decor.picture] * int(np.clip(space.room.area_m2 / 3.2, 2, 7))
    for make in makers:
        piece = make(kit, rng)
        (x0, _, z0), (x1, _, z1) = piece.shape.bounds()
        half = float(x1 - x0) / 2
        for _ in range(14):
            axis, sign = SIDES[int(rng.integers(4))]
            start, end = space.room.span(axis)
            if end - start < 2 * half + 0.4:
                continue
            s = float(rng.uniform(start + half + 0.15, end - half - 0.15))
            zone = space.room.strip(axis, sign, (s - half - 0.08, s + half + 0.08), 0.3)
            holes = space.plan.side(space.index, axis, sign)
            if any(h.start_m - 0.14 < s + half and h.end_m + 0.14 > s - half for h in holes):
                continue
            if any(overlaps(zone, other) for other in occupied):
                continue
            eye = {"Mirror": 1.05, "Coat_rack": 1.7}.get(piece.name, 1.55)
            middle = max(eye, _highest(space, zone) + 0.12 - float(z0))
            if middle + float(z1) > min(2.15, space.plan.ceiling_m - 0.2):
                continue
            placed = at_wall(space, alone(piece.moved(z_m=middle), 0.0, True), axis, sign, s)
            # Hung flat on the wall, not at furniture's distance from it.
            shift = np.zeros(2)
            shift[axis] = sign * (0.02 - 0.001)
            flat = placed.pieces[0].moved(0.0)
            pieces.append(flat.moved(0.0, float(shift[0]), float(shift[1])))
            occupied.append(zone)
            if piece.name == "Coat_rack":
                space.place(placed)
            break
    return pieces
