"""Draw floor plans until one fits: right area and rooms, every room joined to the others."""

from collections.abc import Callable, Sequence

import numpy as np

from ...formats.core.errors import check_name
from ..config import ApartmentConfig
from .flights import draw_steps, least_stairwell_m
from .openings import Openings, contact
from .partition.apartment import FAMILIES, Cell, oriented
from .partition.large import STAIRWELL_DEPTH_M, VILLAS, house, office
from .plan import Block, FloorPlan, Room
from .stairs import stairs_block, upper_void

_TRIES = 400
_FIXED_KINDS = {
    "living": "living room",
    "hall": "hallway",
    "wet": "bathroom",
    "stairs": "stairwell",
}
_COLUMN_M, _COLUMN_SPACING_M = 0.45, 6.0
# Storeys of a house are this much further apart than a room is high.
_SLAB_M = 0.3


def draw_storeys(rng: np.random.Generator, config: ApartmentConfig) -> tuple[FloorPlan, ...]:
    """Return the storeys of a random building of `config.kind`, lowest first.

    Raises:
        UnknownNameError: there is no such kind.
        ValueError: the configuration admits no such building.
    """
    draw = {"apartment": _apartment, "villa": _villa, "house": _house, "office": _office}
    check_name("kind of building", config.kind, draw)
    for _ in range(_TRIES):
        storeys = draw[config.kind](rng, config)
        if storeys and _has_area([r for storey in storeys for r in storey.rooms], config):
            return storeys
    hint = "; valid: ranges inside 80 … 150 m² and 0.8 … 1.0 m"
    raise ValueError(
        f"no {config.kind} of {config.area_m2} m² with doors of {config.door_width_m} m exists"
        f"{hint if config.kind == 'apartment' else ''}"
    )


def _has_area(rooms: Sequence[Room], config: ApartmentConfig) -> bool:
    return config.area_m2[0] <= sum(room.area_m2 for room in rooms) <= config.area_m2[1]


def _apartment(rng: np.random.Generator, config: ApartmentConfig) -> tuple[FloorPlan, ...]:
    return _home(rng, _draw_cells(rng, FAMILIES), config)


def _villa(rng: np.random.Generator, config: ApartmentConfig) -> tuple[FloorPlan, ...]:
    cells = _draw_cells(rng, VILLAS)
    fits = config.rooms[0] <= len(cells) <= config.rooms[1]
    return _home(rng, cells, config) if fits else ()


def _draw_cells(
    rng: np.random.Generator, families: dict[str, Callable[[np.random.Generator], list[Cell]]]
) -> list[Cell]:
    names = sorted(families)
    return oriented(rng, families[names[rng.integers(len(names))]](rng))


def _home(
    rng: np.random.Generator, cells: list[Cell], config: ApartmentConfig
) -> tuple[FloorPlan, ...]:
    rooms = _rooms(cells, _kinds(rng, cells), config)
    plan = _opened(rng, rooms, config) if _has_area(rooms, config) else None
    return (plan,) if plan else ()


def _rooms(cells: list[Cell], kinds: list[str], config: ApartmentConfig) -> list[Room]:
    half = config.wall_m / 2
    return [
        Room(kind, (x0 + half, y0 + half), (x1 - half, y1 - half))
        for kind, (_, x0, y0, x1, y1) in zip(kinds, cells, strict=True)
    ]


def _opened(
    rng: np.random.Generator,
    rooms: Sequence[Room],
    config: ApartmentConfig,
    *,
    blocks: Sequence[Block] = (),
    ceiling_m: float | None = None,
    floor_z_m: float = 0.0,
) -> FloorPlan | None:
    """Return a plan of `rooms` with openings; None if they cannot all be joined."""
    draw = Openings(rng, rooms, config, blocks)
    doors = draw.doors()
    if doors is None:
        return None
    ceiling = float(rng.uniform(*config.ceiling_m)) if ceiling_m is None else ceiling_m
    openings = [*doors, *(draw.entry(doors) if floor_z_m == 0.0 else [])]
    openings += draw.windows(openings, ceiling)
    return FloorPlan(
        tuple(rooms), tuple(openings), config.wall_m, ceiling, floor_z_m, tuple(blocks)
    )


def _shared(cells: list[Cell], a: int, b: int) -> float:
    """Return the length of the wall between two cells [m]."""
    common = contact(cells[a], cells[b])
    return common[3] - common[2] if common else 0.0


def _area(cell: Cell) -> float:
    return (cell[3] - cell[1]) * (cell[4] - cell[2])


def _kinds(rng: np.random.Generator, cells: list[Cell]) -> list[str]:
    """Turn roles into kinds: the cell nearest to the living room is likely the kitchen."""
    kinds = [_FIXED_KINDS.get(role, "") for role, *_ in cells]
    free = [k for k, kind in enumerate(kinds) if not kind]
    living = kinds.index("living room")
    kitchen = max(free, key=lambda k: _shared(cells, k, living))
    kinds[kitchen] = "kitchen"
    free.remove(kitchen)
    extra = ["study", "bedroom", "dining room", "children's room"]
    names = ["bedroom", *(extra[k] for k in rng.permutation(len(extra)))]
    # A large home has more bedrooms; the largest of the rest is the main bedroom.
    names += ["bedroom", "children's room", "study", "bedroom", "bedroom"]
    free.sort(key=lambda k: -_area(cells[k]))
    for k, name in zip(free, names, strict=False):
        kinds[k] = name
    return kinds


def _house(rng: np.random.Generator, config: ApartmentConfig) -> tuple[FloorPlan, ...]:
    shape, steps = config.stairs.shape, draw_steps(rng, config.stairs)
    tallest, shallowest = config.ceiling_m[1] + _SLAB_M, STAIRWELL_DEPTH_M[0] - config.wall_m
    along, away = least_stairwell_m(shape, tallest, steps, shallowest)
    parts = house(rng, (along + config.wall_m, away + config.wall_m))
    if not config.rooms[0] <= sum(map(len, parts)) <= config.rooms[1]:
        return ()
    # Both storeys are turned alike, so that the stairs stay above each other.
    seed = int(rng.integers(1 << 32))
    lower, upper = (oriented(np.random.default_rng(seed), cells) for cells in parts)
    ceiling = float(rng.uniform(*config.ceiling_m))
    kinds = _kinds(rng, lower)
    rooms = _rooms(lower, kinds, config)
    stairs = stairs_block(rooms, config.wall_m, ceiling + _SLAB_M, shape, steps)
    ground = _opened(rng, rooms, config, blocks=[stairs], ceiling_m=ceiling)
    kinds = [_FIXED_KINDS.get(role, "") for role, *_ in upper]
    names = ["bedroom", "children's room", "bedroom", "study", "bedroom"]
    for k in sorted(range(len(upper)), key=lambda k: -_area(upper[k])):
        kinds[k] = kinds[k] or names.pop(0)
    rooms = _rooms(upper, kinds, config)
    height = {"ceiling_m": ceiling, "floor_z_m": ceiling + _SLAB_M}
    first = _opened(rng, rooms, config, blocks=[upper_void(rooms, stairs)], **height)
    return (ground, first) if ground and first else ()


def _office(rng: np.random.Generator, config: ApartmentConfig) -> tuple[FloorPlan, ...]:
    cells = oriented(rng, office(rng))
    rooms = _rooms(cells, [role for role, *_ in cells], config)
    ceiling = float(rng.uniform(*config.ceiling_m))
    columns = [c for k, room in enumerate(rooms) for c in _columns(k, room, ceiling)]
    plan = _opened(rng, rooms, config, blocks=columns, ceiling_m=ceiling)
    return (plan,) if plan else ()


def _columns(index: int, room: Room, ceiling_m: float) -> list[Block]:
    """Return the columns on a regular grid in an open-plan room."""
    if room.kind != "office":
        return []
    spans = np.maximum(np.round(room.size_m / _COLUMN_SPACING_M).astype(int), 1)
    low, blocks = np.asarray(room.lower_m), []
    for i in range(1, spans[0]):
        for j in range(1, spans[1]):
            x, y = (low + room.size_m * (i, j) / spans).tolist()
            half = _COLUMN_M / 2
            ends = (x - half, y - half), (x + half, y + half)
            blocks.append(Block("column", index, *ends, ceiling_m))
    return blocks
