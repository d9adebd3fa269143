"""What all paths of a level share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...formats.scene.bundle import LabeledObject, SceneBundle
from ...formats.scene.staircase import Staircase
from ...wayfinding.regions import ROOM_PREFIX, RegionMap, region_map
from ..language.nouns import noun_of
from .doors import DOOR, Opening, as_thing, find_openings, is_door, shut_doors
from .named import NamedRoom
from .rooms import room_names, rooms_of_boxes

_DOOR_HEIGHT_M = 1.7


@dataclass(frozen=True)
class LevelFacts:
    """What all paths of a level share; build it once.

    Attributes:
        things: objects with a noun, the doorways and the wider openings.
        nouns: their nouns.
        low_m, high_m: (N, 2) their boxes [m].
        rooms: the room each stands in, "" when unknown.
        names: room name of each region.
        openings: between rooms.
        leads: of each thing that is an opening, the names of the rooms that meet in it.
        unnamed: labels that no noun is known for, with how many objects have them.
    """

    bundle: SceneBundle
    level: int
    regions: RegionMap
    things: tuple[LabeledObject, ...]
    nouns: tuple[str, ...]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    rooms: tuple[str, ...]
    names: tuple[str, ...]
    openings: tuple[Opening, ...]
    leads: tuple[tuple[str, ...], ...]
    unnamed: dict[str, int]

    @staticmethod
    def of(
        bundle: SceneBundle,
        level: int,
        regions: RegionMap | None = None,
        named: Sequence[NamedRoom] = (),
    ) -> "LevelFacts":
        """Read a level.

        Args:
            bundle: its scene.
            level: number of the level.
            regions: the level's, where they are known.
            named: rooms of the scene that have no label.
        """
        regions = regions or region_map(bundle, level)
        things: list[LabeledObject] = []
        unnamed: dict[str, int] = {}
        for thing in bundle.objects:
            if thing.level not in (level, -1) or thing.category.startswith(ROOM_PREFIX):
                continue
            if noun_of(thing.category):
                things.append(thing)
            elif thing.category not in _STRUCTURE:
                unnamed[thing.category[:40]] = unnamed.get(thing.category[:40], 0) + 1
        things = [t for t in things if not any(_part_of(t, other) for other in things)]
        if "stairs" not in (noun_of(t.category) for t in things):
            things += [_stairs(s, k, level) for k, s in enumerate(bundle.staircases)
                       if level in s.levels]  # fmt: skip
        doors = [t for t in things if is_door(t)]
        openings = find_openings(regions, doors)
        floor_z_m = bundle.level_floor_z_m[level]
        # A door's leaf and its frame are the doorway that they stand in.
        shut = shut_doors([t for t in doors if _stands(t, floor_z_m)], openings)
        things = [t for t in things if not is_door(t)]
        nouns = [noun_of(t.category) for t in things] + [DOOR] * len(shut)
        nouns += [o.noun for o in openings]
        things += shut
        leads = [()] * len(things)
        things += [as_thing(o, n, level, floor_z_m) for n, o in enumerate(openings, start=1)]
        low = np.array([t.lower_m[:2] for t in things], dtype=np.float64).reshape(-1, 2)
        high = np.array([t.upper_m[:2] for t in things], dtype=np.float64).reshape(-1, 2)
        names = room_names(regions, things, [room for room in named if room.level == level])
        leads += [tuple(sorted({names[k] for k in o.rooms} - {""})) for o in openings]
        return LevelFacts(
            bundle, level, regions, tuple(things), tuple(nouns), low, high,
            rooms_of_boxes(regions, names, low, high), names, tuple(openings), tuple(leads),
            unnamed,
        )  # fmt: skip


def _stands(door: LabeledObject, floor_z_m: float) -> bool:
    """Return whether a door reaches from the floor to over one's head, not one of a cupboard."""
    return door.lower_m[2] < floor_z_m + 0.3 and door.upper_m[2] > floor_z_m + _DOOR_HEIGHT_M


def _stairs(stairs: Staircase, number: int, level: int) -> LabeledObject:
    """Return a staircase as an object of one of the levels that it joins."""
    line = stairs.line_world_m
    low, high = line.min(axis=0), line.max(axis=0)
    low[:2] -= 0.5 * stairs.width_m
    high[:2] += 0.5 * stairs.width_m
    lower, upper = ((float(x), float(y), float(z)) for x, y, z in (low, high))
    return LabeledObject(f"stairs-{number}", "stairs", lower, upper, level)


_STRUCTURE = frozenset(
    """wall,floor,ceiling,roof,beam,board,misc,object,other,unknown,opening,doorway,room,window,frame,
door frame,window frame,wall face,invisible wall face,global mesh,
banister""".replace("\n", "").split(",")
)


def _part_of(small: LabeledObject, large: LabeledObject) -> bool:
    """Return whether a box lies mostly over another of its kind, as the parts of one thing do."""
    if small.category != large.category or small.name == large.name:
        return False
    size = np.prod(np.subtract(small.upper_m, small.lower_m)[:2])
    other = np.prod(np.subtract(large.upper_m, large.lower_m)[:2])
    low = np.maximum(small.lower_m, large.lower_m)[:2]
    high = np.minimum(small.upper_m, large.upper_m)[:2]
    shared = np.prod(np.maximum(high - low, 0.0))
    return bool(shared > 0.5 * size and (size, small.name) < (other, large.name))
