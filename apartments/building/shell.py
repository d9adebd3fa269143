"""Floors, ceilings, walls with their openings, door frames and windows."""

from collections.abc import Callable

import numpy as np

from ..materials import pictures
from ..materials.palette import Palette
from ..materials.styles import RoomStyle
from .furniture.piece import Piece
from .plan import SIDES, Block, FloorPlan, Opening, Room
from .shapes import Triangles, box, join, quad

_CASING_M, _CASING_DEPTH_M = 0.07, 0.016
_BASEBOARD_M, _BASEBOARD_DEPTH_M = 0.085, 0.014
_WINDOW_DEPTH_M = 0.14

Place = Callable[[float, float, float], np.ndarray]


def wall_frame(room: Room, axis: int, sign: int) -> Place:
    """Return the map (along, outward, height) [m] → world point (3,) for one side of a room."""
    face = room.wall_at(axis, sign)

    def place(along: float, outward: float, height: float) -> np.ndarray:
        point = np.empty(3)
        point[axis], point[1 - axis], point[2] = face + sign * outward, along, height
        return point

    return place


def _slab(
    place: Place, a: tuple[float, float, float], b: tuple[float, float, float], material: int
) -> Triangles:
    p, q = place(*a), place(*b)
    return box(np.minimum(p, q), np.maximum(p, q), material)


def _patch(place: Place, s0: float, s1: float, z0: float, z1: float, material: int) -> Triangles:
    """Return a piece of wall; uv continues over the whole wall."""
    flat = quad(place(s0, 0, z0), place(s1, 0, z0) - place(s0, 0, z0), (0, 0, z1 - z0), material)
    return Triangles(flat.corners, flat.uv + np.array([s0, z0]), flat.material)


def floor_and_ceiling(plan: FloorPlan, index: int, style: RoomStyle) -> list[Piece]:
    """Return a room's floor, reaching half through its doorways, and its ceiling."""
    room = plan.rooms[index]
    (x0, y0), (x1, y1) = room.lower_m, room.upper_m
    voids = [b.rect() for b in plan.blocks_of(index, "void")]
    stairs = [b.rect() for b in plan.blocks_of(index, "stairs")]
    pieces = _sheet(np.array([[x0, y0], [x1, y1]]), 0.0, style.floor, voids)
    for door in plan.doors_of(index):
        if door.kind == "entry":
            continue
        place = wall_frame(room, door.axis, door.sign)
        p, q = place(door.start_m, 0.0, 0.0), place(door.end_m, plan.wall_m / 2, 0.0)
        low, high = np.minimum(p, q), np.maximum(p, q)
        pieces.append(_horizontal(low[0], low[1], high[0], high[1], 0.0, style.floor))
    ceiling = _sheet(np.array([[x0, y0], [x1, y1]]), plan.ceiling_m, style.ceiling, stairs)
    return [Piece("Floor", "floor", join(pieces)), Piece("Ceiling", "ceiling", join(ceiling))]


def _sheet(rect: np.ndarray, z: float, material: int, holes: list[np.ndarray]) -> list[Triangles]:
    """Return a horizontal rectangle (2, 2) without at most one hole (2, 2) inside it."""
    (x0, y0), (x1, y1) = rect.tolist()
    if not holes:
        return [_horizontal(x0, y0, x1, y1, z, material)]
    (a0, b0), (a1, b1) = holes[0].tolist()
    parts = ((x0, y0, a0, y1), (a1, y0, x1, y1), (a0, y0, a1, b0), (a0, b1, a1, y1))
    return [
        _horizontal(*part, z, material)
        for part in parts
        if part[2] - part[0] > 1e-6 and part[3] - part[1] > 1e-6
    ]


def _horizontal(x0: float, y0: float, x1: float, y1: float, z: float, material: int) -> Triangles:
    flat = quad((x0, y0, z), (x1 - x0, 0, 0), (0, y1 - y0, 0), material)
    return Triangles(flat.corners, flat.uv + np.array([x0, y0]), flat.material)


def walls(plan: FloorPlan, index: int, style: RoomStyle) -> list[Piece]:
    """Return the four walls of a room with holes for its openings, and baseboards."""
    room, pieces = plan.rooms[index], []
    for k, (axis, sign) in enumerate(SIDES):
        place = wall_frame(room, axis, sign)
        holes = sorted(plan.side(index, axis, sign), key=lambda o: o.start_m)
        upper = style.accent if k == style.accent_side else style.wall
        bands = [(0.0, plan.ceiling_m, upper)]
        if style.lower >= 0:
            bands = [(0.0, style.lower_m, style.lower), (style.lower_m, plan.ceiling_m, upper)]
        shapes: list[Triangles] = []
        start, end = room.span(axis)
        at = start
        for hole in [*holes, None]:
            stop = end if hole is None else hole.start_m
            spans = [(at, stop, 0.0, plan.ceiling_m)]
            if hole is not None:
                spans.append((hole.start_m, hole.end_m, 0.0, hole.bottom_m))
                spans.append((hole.start_m, hole.end_m, hole.top_m, plan.ceiling_m))
                at = hole.end_m
            for s0, s1, z0, z1 in spans:
                for low, high, material in bands:
                    bottom, top = max(z0, low), min(z1, high)
                    if s1 - s0 > 1e-6 and top - bottom > 1e-6:
                        shapes.append(_patch(place, s0, s1, bottom, top, material))
        shapes += _baseboards(place, start, end, holes, style.trim)
        if style.lower >= 0:
            for s0, s1 in _between(start, end, holes):
                ledge = (s0, -0.02, style.lower_m - 0.02), (s1, 0.0, style.lower_m + 0.02)
                shapes.append(_slab(place, *ledge, style.trim))
        pieces.append(Piece("Wall", "wall", join(shapes)))
    return pieces


def _between(
    start: float, end: float, holes: list[Opening], only_doors: bool = False
) -> list[tuple[float, float]]:
    """Return the stretches of a wall beside its openings, clear of door casings."""
    spans, at = [], start
    for hole in holes:
        if hole.kind == "window" and only_doors:
            continue
        margin = 0.0 if hole.kind == "window" else _CASING_M
        if hole.start_m - margin - at > 0.02:
            spans.append((at, hole.start_m - margin))
        at = hole.end_m + margin
    if end - at > 0.02:
        spans.append((at, end))
    return spans


def _baseboards(
    place: Place, start: float, end: float, holes: list[Opening], trim: int
) -> list[Triangles]:
    return [
        _slab(place, (s0, -_BASEBOARD_DEPTH_M, 0.0), (s1, 0.0, _BASEBOARD_M), trim)
        for s0, s1 in _between(start, end, holes, only_doors=True)
    ]


def _casing(place: Place, o: Opening, trim: int) -> list[Triangles]:
    d, c = -_CASING_DEPTH_M, _CASING_M
    return [
        _slab(place, (o.start_m - c, d, 0.0), (o.start_m, 0.0, o.top_m + c), trim),
        _slab(place, (o.end_m, d, 0.0), (o.end_m + c, 0.0, o.top_m + c), trim),
        _slab(place, (o.start_m, d, o.top_m), (o.end_m, 0.0, o.top_m + c), trim),
    ]


def _reveal(place: Place, o: Opening, depth: float, material: int) -> list[Triangles]:
    """Return the sides, top and (for windows) bottom of the hole through the wall."""
    height = o.top_m - o.bottom_m
    into = place(0, depth, 0) - place(0, 0, 0)
    along = place(o.end_m, 0, 0) - place(o.start_m, 0, 0)
    up = np.array([0.0, 0.0, height])
    low = place(o.start_m, 0, o.bottom_m)
    faces = [
        quad(low, into, up, material),
        quad(low + along, into, up, material),
        quad(low + up, along, into, material),
    ]
    if o.bottom_m > 0:
        faces.append(quad(low, along, into, material))
    return faces


def door_frame(plan: FloorPlan, door: Opening, trim: int) -> Piece:
    """Return the casings on both sides of a doorway and the lining between them."""
    shapes: list[Triangles] = []
    for room, sign in ((door.room, door.sign), (door.other_room, -door.sign)):
        place = wall_frame(plan.rooms[room], door.axis, sign)
        shapes += _casing(place, door, trim)
        shapes += _reveal(place, door, plan.wall_m / 2, trim)
    return Piece("Door_frame", "door frame", join(shapes))


def passage_lining(plan: FloorPlan, passage: Opening, near: int, far: int) -> Piece:
    """Return the sides of a wide passage through a wall, in the materials of the walls it joins."""
    shapes: list[Triangles] = []
    for room, sign, material in (
        (passage.room, passage.sign, near),
        (passage.other_room, -passage.sign, far),
    ):
        place = wall_frame(plan.rooms[room], passage.axis, sign)
        shapes += _reveal(place, passage, plan.wall_m / 2, material)
    return Piece("Wall", "wall", join(shapes))


def column(block: Block, material: int) -> Piece:
    """Return a square column from the floor to the ceiling."""
    shape = box((*block.lower_m, 0.0), (*block.upper_m, block.top_m), material)
    return Piece("Column", "column", shape)


def entry_door(plan: FloorPlan, door: Opening, trim: int, palette: Palette, color: tuple) -> Piece:
    """Return the closed front door."""
    place = wall_frame(plan.rooms[door.room], door.axis, door.sign)
    size = (door.end_m - door.start_m, door.top_m)
    leaf = palette.unique("front door", pictures.panel_door, size, color)
    low = place(door.start_m, 0.05, 0.0)
    shapes = [
        *_casing(place, door, trim),
        *_reveal(place, door, 0.05, trim),
        quad(low, place(door.end_m, 0.05, 0.0) - low, (0, 0, door.top_m), leaf),
    ]
    return Piece("Door", "door", join(shapes))


def window(plan: FloorPlan, hole: Opening, trim: int, palette: Palette) -> Piece:
    """Return a window: bright view, reveal, sill and a narrow frame."""
    place = wall_frame(plan.rooms[hole.room], hole.axis, hole.sign)
    width, height = hole.end_m - hole.start_m, hole.top_m - hole.bottom_m
    panes = 1 if width < 0.95 else (2 if width < 1.75 else 3)
    view = palette.unique(
        "window view", pictures.window_view, (width, height), panes, emissive=True
    )
    low = place(hole.start_m, _WINDOW_DEPTH_M, hole.bottom_m)
    pane = quad(low, place(hole.end_m, _WINDOW_DEPTH_M, hole.bottom_m) - low, (0, 0, height), view)
    sill = _slab(
        place,
        (hole.start_m - 0.04, -0.05, hole.bottom_m - 0.03),
        (hole.end_m + 0.04, _WINDOW_DEPTH_M, hole.bottom_m + 0.005),
        trim,
    )
    return Piece(
        "Window", "window", join([pane, *_reveal(place, hole, _WINDOW_DEPTH_M, trim), sill])
    )
