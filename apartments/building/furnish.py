"""Furnish the rooms of a home, and choose the function that furnishes each kind of room."""

from collections.abc import Callable

import numpy as np

from ..materials.kit import Kit
from . import furnish_office
from .furniture import bath, beds, decor, kitchen, seating, storage, tables
from .furniture.piece import Arrangement, Piece, alone
from .space import RoomSpace, first_at_wall, first_in_middle, put_at_walls, try_wall

_LARGE_LIVING_ROOM_M2 = 44.0

Furnisher = Callable[[RoomSpace, Kit, np.random.Generator], list[Piece]]


def _dining_set(
    space: RoomSpace, kit: Kit, rng: np.random.Generator, sizes: tuple[int, ...]
) -> list[Piece]:
    """Return the largest dining set that fits, free in the room; none if none fits."""
    sets = (tables.dining_set(kit, rng, seats) for seats in sizes)
    return first_in_middle(space, rng, sets, 36)


def _wardrobe(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the widest wardrobe that fits."""
    return first_at_wall(space, rng, (alone(storage.wardrobe(kit, rng, n), 0.6) for n in (4, 3, 2)))


def _rug(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a rug in the free middle of the room."""
    size = np.minimum(space.room.size_m * rng.uniform(0.35, 0.5, 2), (2.4, 2.4))
    return [_centered(space, decor.rug(kit, rng, float(size[0]), float(size[1])))]


def _centered(space: RoomSpace, piece: Piece) -> Piece:
    x, y = space.bounds.mean(0).tolist()
    return piece.moved(0.0, x, y)


def _corner_things(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    items = [alone(decor.plant(kit, rng), 0.1, on_window=True) for _ in range(rng.integers(1, 3))]
    if rng.random() < 0.7:
        items.append(alone(decor.floor_lamp(kit, rng), 0.1))
    return put_at_walls(space, rng, items)


def living_room(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a sofa with coffee table and rug, a television, shelf, armchair, perhaps a table."""
    pieces: list[Piece] = []
    for seats in (3, 2):
        lounge = try_wall(space, rng, _lounge(kit, rng, seats, 0.5))
        if lounge is not None:
            pieces += lounge.item.pieces
            screen = Arrangement(tuple(storage.tv_stand(kit, rng, 1.7)), 0.5)
            side = (lounge.axis, -lounge.sign)
            opposite = try_wall(space, rng, screen, [side], lounge.along_m)
            small = Arrangement(tuple(storage.tv_stand(kit, rng, 1.15)), 0.3)
            screens = [screen, small]
            pieces += opposite.item.pieces if opposite else first_at_wall(space, rng, screens)
            break
    if space.room.area_m2 > 21:
        pieces += _dining_set(space, kit, rng, (4, 2))
    items = [alone(storage.bookshelf(kit, rng), 0.4)]
    if rng.random() < 0.8:
        items.append(alone(seating.armchair(kit, rng), 0.4, on_window=True))
    if rng.random() < 0.6:
        items.append(alone(storage.sideboard(kit, rng), 0.4))
    if space.room.area_m2 > _LARGE_LIVING_ROOM_M2:
        items += _second_lounge(kit, rng)
    pieces += put_at_walls(space, rng, items)
    return pieces + _corner_things(space, kit, rng)


def _lounge(kit: Kit, rng: np.random.Generator, seats: int, front_m: float) -> Arrangement:
    """Return a sofa with a coffee table and a rug before it."""
    couch = seating.sofa(kit, rng, seats)
    depth = float(couch.shape.bounds()[1, 1])
    table = tables.coffee_table(kit, rng).moved(0.0, 0.0, depth + 0.7)
    carpet = decor.rug(kit, rng, 2.3, 1.5).moved(0.0, 0.0, depth + 0.55)
    return Arrangement((couch, table, carpet), front_m, on_window=True)


def _second_lounge(kit: Kit, rng: np.random.Generator) -> list[Arrangement]:
    """Return what fills a living room that is larger than any apartment's."""
    return [
        _lounge(kit, rng, 2, 0.4),
        alone(storage.bookshelf(kit, rng), 0.4),
        alone(storage.bookshelf(kit, rng), 0.4),
        alone(seating.armchair(kit, rng), 0.4, on_window=True),
        alone(storage.dresser(kit, rng), 0.4, on_window=True),
        alone(decor.plant(kit, rng), 0.1, on_window=True),
    ]


def kitchen_room(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a run of cupboards and a table with chairs."""
    longest = float(space.room.size_m.max())
    # Windows may leave no wall for what is tall: then the refrigerator stands by itself.
    forms = ((True, True), (False, True), (False, False))
    counters = (
        kitchen.counter(kit, rng, width, upper, fridge)
        for upper, fridge in forms
        for width in (3.8, 3.3, 2.8, 2.4, 2.1)
        if width < longest - 0.05
    )
    pieces = first_at_wall(space, rng, counters)
    if not any(piece.name == "Refrigerator" for piece in pieces):
        pieces += put_at_walls(space, rng, [alone(kitchen.refrigerator(kit), 0.5)])
    pieces += _dining_set(space, kit, rng, (6, 4, 2) if rng.random() < 0.4 else (4, 2))
    items = [alone(storage.sideboard(kit, rng), 0.4)] if rng.random() < 0.5 else []
    items.append(alone(storage.bin_(kit, rng), 0.1))
    return pieces + put_at_walls(space, rng, items) + _corner_things(space, kit, rng)[:1]


def dining_room(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a large table and a sideboard."""
    pieces = _dining_set(space, kit, rng, (6, 4, 2))
    items = [alone(storage.sideboard(kit, rng)), alone(storage.bookshelf(kit, rng))]
    pieces += put_at_walls(space, rng, items)
    return pieces + _corner_things(space, kit, rng)


def bedroom(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a double bed with nightstands, wardrobe, dresser, rug, a chair."""
    sizes = ((1.7, 2), (1.5, 2), (1.5, 1), (1.0, 1), (0.95, 0))
    pieces = first_at_wall(space, rng, (beds.bed_set(kit, rng, *size) for size in sizes))
    pieces += _wardrobe(space, kit, rng)
    pieces += put_at_walls(space, rng, [alone(storage.dresser(kit, rng), 0.5)])
    extra = [seating.armchair, seating.pouf][int(rng.integers(2))](kit, rng)
    pieces += put_at_walls(space, rng, [alone(extra, 0.3, on_window=True)])
    return pieces + _rug(space, kit, rng) + _corner_things(space, kit, rng)


def childrens_room(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a single bed, desk, bright shelf, toys."""
    pieces = first_at_wall(space, rng, (beds.bed_set(kit, rng, 0.95, n) for n in (1, 0)))
    pieces += _wardrobe(space, kit, rng)
    items = [
        tables.desk_set(kit, rng),
        alone(storage.toy_shelf(kit, rng), 0.4),
        alone(seating.pouf(kit, rng), 0.2, on_window=True),
    ]
    return pieces + put_at_walls(space, rng, items) + _rug(space, kit, rng)


def study(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a desk, shelves of books, an armchair or a day bed."""
    items = [tables.desk_set(kit, rng)]
    items += [alone(storage.bookshelf(kit, rng)) for _ in range(2)]
    if rng.random() < 0.5:
        items.append(alone(seating.sofa(kit, rng, 2), 0.4, on_window=True))
    items.append(alone(seating.armchair(kit, rng), 0.3, on_window=True))
    pieces = put_at_walls(space, rng, items) + _rug(space, kit, rng)
    return pieces + _corner_things(space, kit, rng)


def bathroom(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a tub, toilet, washbasin with mirror, washing machine and towels."""
    items = [
        alone(bath.toilet(kit, rng), 0.5, on_window=True),
        alone(bath.bathtub(kit, rng), 0.5, on_window=True),
        Arrangement(tuple(bath.washbasin(kit, rng)), 0.5),
        alone(bath.washing_machine(kit, rng), 0.5),
        alone(bath.towel_rail(kit, rng), 0.2),
        alone(storage.basket(kit, rng), 0.1),
    ]
    mat = decor.rug(kit, rng, 0.85, 0.55)
    return [*put_at_walls(space, rng, items), _centered(space, mat)]


def hallway(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return shallow things only: a shoe cabinet, a bench, a runner rug."""
    items = [alone(storage.shoe_cabinet(kit, rng), 0.5), alone(seating.bench(kit, rng), 0.5)]
    size = space.room.size_m
    long = int(size[1] > size[0])
    length, width = float(min(size.max() * 0.6, 3.0)), float(min(0.45 * size.min(), 0.8))
    runner = decor.rug(kit, rng, length, width).moved(long * np.pi / 2)
    return [*put_at_walls(space, rng, items), _centered(space, runner)]


def stairwell(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a plant beside the stairs."""
    return put_at_walls(space, rng, [alone(decor.plant(kit, rng), 0.1, on_window=True)])


_HOME: dict[str, Furnisher] = {
    "living room": living_room,
    "kitchen": kitchen_room,
    "dining room": dining_room,
    "bedroom": bedroom,
    "children's room": childrens_room,
    "study": study,
    "bathroom": bathroom,
    "hallway": hallway,
    "stairwell": stairwell,
}
_OFFICE: dict[str, Furnisher] = {
    "office": furnish_office.open_office,
    "meeting room": furnish_office.meeting_room,
    "kitchen": kitchen_room,
    "bathroom": furnish_office.restroom,
    "storeroom": furnish_office.storeroom,
    "hallway": furnish_office.office_corridor,
}


def furnisher(building: str, room: str) -> Furnisher:
    """Return the function that furnishes a kind of room in a kind of building."""
    return (_OFFICE if building == "office" else _HOME)[room]
