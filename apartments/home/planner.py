"""Draws floor plans until one is a home: right area, every room joined to the others."""

from __future__ import annotations

import numpy as np

from ..config import ApartmentConfig
from .partition import FAMILIES, Cell, oriented
from .plan import SIDES, FloorPlan, Opening, Room

_DOOR_MARGIN_M = 0.22
_TRIES = 400


def draw_plan(rng: np.random.Generator, config: ApartmentConfig) -> FloorPlan:
    """A random plan with `config`'s area and door sizes.

    Raises:
        ValueError: the configuration admits no home.
    """
    names = sorted(FAMILIES)
    for _ in range(_TRIES):
        cells = oriented(rng, FAMILIES[names[rng.integers(len(names))]](rng))
        plan = _plan(rng, cells, config)
        if plan is not None:
            return plan
    raise ValueError(
        f"no home of {config.area_m2} m² with doors of {config.door_width_m} m found; "
        "valid: ranges inside 80 … 150 m² and 0.8 … 1.0 m"
    )


def _plan(rng: np.random.Generator, cells: list[Cell], config: ApartmentConfig) -> FloorPlan | None:
    half = config.wall_m / 2
    kinds = _kinds(rng, cells)
    rooms = [
        Room(kind, (x0 + half, y0 + half), (x1 - half, y1 - half))
        for kind, (_, x0, y0, x1, y1) in zip(kinds, cells, strict=True)
    ]
    area = sum(room.area_m2 for room in rooms)
    if not config.area_m2[0] <= area <= config.area_m2[1]:
        return None
    doors = _doors(rng, rooms, config)
    if doors is None:
        return None
    ceiling = float(rng.uniform(*config.ceiling_m))
    openings = [*doors, *_entry(rng, rooms, doors, config)]
    openings += _windows(rng, rooms, openings, config, ceiling)
    return FloorPlan(tuple(rooms), tuple(openings), config.wall_m, ceiling)


def _kinds(rng: np.random.Generator, cells: list[Cell]) -> list[str]:
    """Turn roles into kinds: the cell nearest to the living room is likely the kitchen."""
    fixed = {"living": "living room", "hall": "hallway", "wet": "bathroom"}
    kinds = [fixed.get(role, "") for role, *_ in cells]
    free = [k for k, kind in enumerate(kinds) if not kind]
    living = next(k for k, kind in enumerate(kinds) if kind == "living room")

    def shared(k: int) -> float:
        return max(
            (end - start for *_, start, end in _contacts(cells[k], cells[living])), default=0
        )

    kitchen = max(free, key=shared)
    kinds[kitchen] = "kitchen"
    free.remove(kitchen)
    extra = ["study", "bedroom", "dining room", "children's room"]
    names = ["bedroom", *(extra[k] for k in rng.permutation(len(extra)))]
    # The largest of the rest is the main bedroom.
    free.sort(key=lambda k: -(cells[k][3] - cells[k][1]) * (cells[k][4] - cells[k][2]))
    for k, name in zip(free, names, strict=False):
        kinds[k] = name
    return kinds


def _contacts(a: Cell, b: Cell) -> list[tuple[int, int, float, float]]:
    """Common wall of two cells seen from `a`: (axis, sign, start, end), at most one."""
    low = np.array([a[1:3], b[1:3]])
    high = np.array([a[3:5], b[3:5]])
    for axis, sign in SIDES:
        mine = high[0, axis] if sign > 0 else low[0, axis]
        theirs = low[1, axis] if sign > 0 else high[1, axis]
        start = max(low[0, 1 - axis], low[1, 1 - axis])
        end = min(high[0, 1 - axis], high[1, 1 - axis])
        if abs(mine - theirs) < 1e-6 and end - start > 1e-6:
            return [(axis, sign, float(start), float(end))]
    return []


def _room_contacts(rooms: list[Room], wall_m: float) -> dict[tuple[int, int], tuple]:
    cells = [
        (
            "",
            r.lower_m[0] - wall_m / 2,
            r.lower_m[1] - wall_m / 2,
            r.upper_m[0] + wall_m / 2,
            r.upper_m[1] + wall_m / 2,
        )
        for r in rooms
    ]
    found = {}
    for i in range(len(rooms)):
        for j in range(len(rooms)):
            if i != j and (contact := _contacts(cells[i], cells[j])):
                axis, sign, start, end = contact[0]
                found[i, j] = (axis, sign, start + wall_m / 2, end - wall_m / 2)
    return found


_PUBLIC = {"hallway": 0, "living room": 1, "kitchen": 2, "dining room": 3}


def _doors(
    rng: np.random.Generator, rooms: list[Room], config: ApartmentConfig
) -> list[Opening] | None:
    """A spanning tree of doorways through public rooms, plus some loops; None if impossible."""
    contacts = _room_contacts(rooms, config.wall_m)
    need = config.door_width_m[1] + 2 * _DOOR_MARGIN_M
    usable = {(i, j): c for (i, j), c in contacts.items() if i < j and c[3] - c[2] >= need}

    def cost(pair: tuple[int, int]) -> float:
        ranks = sorted(_PUBLIC.get(rooms[k].kind, 6) for k in pair)
        return ranks[0] * 10 + ranks[1]

    group = list(range(len(rooms)))
    chosen: list[tuple[int, int]] = []
    leaves = {"bathroom", "bedroom", "study", "children's room"}
    for i, j in sorted(usable, key=cost):
        private = rooms[i].kind in leaves and rooms[j].kind in leaves
        open_plan = {rooms[i].kind, rooms[j].kind} == {"kitchen", "living room"}
        loop = not private and "bathroom" not in (rooms[i].kind, rooms[j].kind)
        if group[i] != group[j] or open_plan or (loop and rng.random() < 0.3):
            if private and group[i] != group[j] and "bathroom" in (rooms[i].kind, rooms[j].kind):
                continue
            chosen.append((i, j))
            old = group[j]
            group = [group[i] if g == old else g for g in group]
    if len(set(group)) > 1:
        return None
    doors: list[Opening] = []
    for i, j in chosen:
        axis, sign, start, end = usable[i, j]
        width = float(rng.uniform(*config.door_width_m))
        room_left = end - start - width - 2 * _DOOR_MARGIN_M
        # Doors near a corner leave whole walls for furniture.
        where = float(np.clip(rng.choice([0.08, 0.5, 0.92]) + rng.normal(0, 0.06), 0, 1))
        first = start + _DOOR_MARGIN_M + where * room_left
        hole = (first, first + width, 0.0, config.door_height_m)
        doors.append(Opening("door", i, axis, sign, *hole, other_room=j))
        doors.append(Opening("door", j, axis, -sign, *hole, other_room=i))
    return doors


def _free_spans(
    room: int,
    axis: int,
    sign: int,
    rooms: list[Room],
    openings: list[Opening],
    wall_m: float,
) -> list[tuple[float, float]]:
    """Stretches of a room's side that face the outside and hold no opening."""
    low, high = rooms[room].span(axis)
    taken = [
        (c[2] - wall_m, c[3] + wall_m)
        for (i, _), c in _room_contacts(rooms, wall_m).items()
        if i == room and (c[0], c[1]) == (axis, sign)
    ]
    taken += [
        (o.start_m, o.end_m) for o in openings if (o.room, o.axis, o.sign) == (room, axis, sign)
    ]
    spans, at = [], low
    for start, end in sorted(taken):
        if start - at > 0.5:
            spans.append((at, start))
        at = max(at, end)
    if high - at > 0.5:
        spans.append((at, high))
    return spans


def _entry(
    rng: np.random.Generator, rooms: list[Room], doors: list[Opening], config: ApartmentConfig
) -> list[Opening]:
    """The closed front door, in a hallway or the living room; none if there is no outer wall."""
    for kind in ("hallway", "living room"):
        for index in (k for k, room in enumerate(rooms) if room.kind == kind):
            sides = [
                (axis, sign, span)
                for axis, sign in SIDES
                for span in _free_spans(index, axis, sign, rooms, doors, config.wall_m)
                if span[1] - span[0] > 1.3
            ]
            if sides:
                axis, sign, (start, end) = sides[rng.integers(len(sides))]
                first = float(rng.uniform(start + 0.2, end - 1.15))
                return [Opening("entry", index, axis, sign, first, first + 0.95, 0.0, 2.08)]
    return []


def _windows(
    rng: np.random.Generator,
    rooms: list[Room],
    openings: list[Opening],
    config: ApartmentConfig,
    ceiling_m: float,
) -> list[Opening]:
    """Windows on outer walls; small and high in bathrooms, to the floor in some living rooms."""
    windows: list[Opening] = []
    for index, room in enumerate(rooms):
        for axis, sign in SIDES:
            for start, end in _free_spans(index, axis, sign, rooms, openings, config.wall_m):
                length = end - start
                if length < 1.3 or (room.kind != "living room" and rng.random() < 0.2):
                    continue
                bottom, top = float(rng.uniform(0.75, 0.95)), float(rng.uniform(2.1, 2.25))
                width = float(min(rng.uniform(1.1, 1.9), length - 0.5))
                if room.kind == "bathroom":
                    bottom, width = 1.3, min(width, 0.9)
                elif room.kind == "kitchen":
                    bottom = 1.12
                elif room.kind == "living room":
                    width = float(min(rng.uniform(1.6, 2.4), length - 0.5))
                    bottom = float(rng.choice([0.35, bottom]))
                count = 2 if length > 2.6 * width and length > 4.2 else 1
                for k in range(count):
                    middle = start + length * (k + 0.5) / count
                    middle += float(rng.uniform(-0.5, 0.5)) * max(length / count - width - 0.5, 0)
                    windows.append(
                        Opening(
                            "window",
                            index,
                            axis,
                            sign,
                            middle - width / 2,
                            middle + width / 2,
                            bottom,
                            min(top, ceiling_m - 0.2),
                        )
                    )
    return windows
