"""Furnish the rooms of an office."""

import numpy as np

from ..materials.kit import Kit
from .furniture import bath, decor, office, seating, storage
from .furniture.piece import Arrangement, Piece, alone
from .space import RoomSpace, first_in_middle, overlaps, put_at_walls

# Between two rows of desk islands people pass each other.
_AISLE_M = 1.1


def open_office(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the rows of desk islands, cabinets and a sofa at the walls, plants."""
    pieces: list[Piece] = []
    along = int(np.argmax(space.room.size_m))
    pairs = int(rng.integers(2, 4))
    sample = office.desk_island(kit, np.random.default_rng(0), pairs)
    size = np.diff(sample.bounds()[:, :2], axis=0)[0] + 0.2
    across_yaw = 0.5 * np.pi if along == 0 else 0.0
    if along == 0:
        size = size[::-1]
    count = np.floor((space.room.size_m - 0.6) / (size + _AISLE_M)).astype(int)
    low, islands = np.asarray(space.room.lower_m), []
    for i in range(count[0]):
        for j in range(count[1]):
            if rng.random() < 0.1:
                continue  # An island is left out here and there, as in a real office.
            item = office.desk_island(kit, rng, pairs).moved(across_yaw, 0.0, 0.0)
            middle = low + space.room.size_m * (np.array([i, j]) + 0.5) / count
            for shift in ((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)):
                placed = item.moved(0.0, float(middle[0] + shift[0]), float(middle[1] + shift[1]))
                zone = placed.bounds()[:, :2]
                clear = all(not overlaps(zone, other, _AISLE_M) for other in islands)
                if clear and space.fits(placed):
                    islands.append(zone)
                    space.place(placed)
                    pieces += placed.pieces
                    break
    return pieces + put_at_walls(space, rng, _wall_things(space, kit, rng))


def _wall_things(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Arrangement]:
    items = [alone(seating.sofa(kit, rng, 3), 0.6, on_window=True)]
    choices = (
        lambda: alone(storage.bookshelf(kit, rng), 0.9),
        lambda: alone(office.filing_cabinet(kit, rng, 3), 0.9),
        lambda: alone(decor.plant(kit, rng), 0.3, on_window=True),
        lambda: alone(storage.sideboard(kit, rng), 0.9, on_window=True),
    )
    items += [choices[rng.integers(4)]() for _ in range(int(space.room.area_m2 / 28))]
    return items


def meeting_room(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return a conference table with chairs, a television or a whiteboard, a plant."""
    sets = (office.conference_set(kit, rng, seats) for seats in (8, 6, 4))
    pieces = first_in_middle(space, rng, sets, 30)
    screen = Arrangement(tuple(storage.tv_stand(kit, rng, 1.4)), 0.2)
    items = [screen, alone(office.whiteboard(kit, rng), 0.2)]
    items.append(alone(decor.plant(kit, rng), 0.1, on_window=True))
    return pieces + put_at_walls(space, rng, items)


def restroom(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return toilets, a washbasin and a bin."""
    items = [alone(bath.toilet(kit, rng), 0.5, on_window=True)]
    items += [Arrangement(tuple(bath.washbasin(kit, rng)), 0.5)]
    items += [alone(bath.toilet(kit, rng), 0.5, on_window=True), alone(storage.bin_(kit, rng), 0.1)]
    return put_at_walls(space, rng, items)


def storeroom(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the shelves and cabinets."""
    items = [alone(storage.bookshelf(kit, rng), 0.5) for _ in range(3)]
    items += [alone(office.filing_cabinet(kit, rng, 2), 0.5), alone(storage.basket(kit, rng), 0.1)]
    return put_at_walls(space, rng, items)


def office_corridor(space: RoomSpace, kit: Kit, rng: np.random.Generator) -> list[Piece]:
    """Return the benches and plants."""
    items = [alone(seating.bench(kit, rng), 0.5) for _ in range(2)]
    items += [alone(decor.plant(kit, rng), 0.1, on_window=True) for _ in range(3)]
    return put_at_walls(space, rng, items)
