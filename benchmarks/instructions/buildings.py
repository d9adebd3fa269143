"""Generated buildings as the maps that facts and follower need, without scan and repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlnpe.apartments import building_config
from vlnpe.apartments.home.building import build_scene
from vlnpe.apartments.truth import true_floor
from vlnpe.formats.scene.bundle import LabeledObject
from vlnpe.wayfinding.regions import ROOM_PREFIX, RegionMap, split_rooms

_CELL_M = 0.05
_LOW_M, _HIGH_M = 0.9, 1.7  # what fills these heights bounds the open floor, as walls do
_OPENINGS = frozenset(("door", "door frame", "window", "floor", "ceiling", "wall"))


@dataclass(frozen=True)
class Building:
    """The ground floor of a generated building, as much of a `SceneBundle` as facts read.

    Attributes:
        objects: things and rooms.
        level_floor_z_m: height of each floor [m].
        regions: its rooms.
    """

    objects: tuple[LabeledObject, ...]
    level_floor_z_m: tuple[float, ...]
    regions: RegionMap


def building(kind: str, seed: int) -> Building:
    """Return the building of a seed; the same as `vlnpe scan SEED --kind KIND --exact` writes."""
    scene = build_scene(np.random.default_rng(seed), building_config(kind), painted=False)
    plan = scene.plan
    low, high = plan.floor_z_m, plan.floor_z_m + plan.ceiling_m
    objects = [LabeledObject(o.name, o.category, o.lower_m, o.upper_m, 0) for o in scene.objects]
    counts: dict[str, int] = {}
    for room in plan.rooms:
        counts[room.kind] = counts.get(room.kind, 0) + 1
        name = f"Room_{room.kind}_{counts[room.kind]}"
        ends = (*map(float, room.lower_m), low), (*map(float, room.upper_m), high)
        objects.append(LabeledObject(name, ROOM_PREFIX + room.kind, *ends, 0))
    grid, floor = true_floor(plan, _CELL_M)
    for thing in objects:
        _stand(floor, grid.center_of, thing)
    return Building(tuple(objects), (low,), split_rooms(floor, objects, grid))


def _stand(floor: NDArray[np.bool_], center_of, thing: LabeledObject) -> None:
    """Take what a tall thing covers from the open floor (rows, columns)."""
    tall = thing.lower_m[2] < _LOW_M and thing.upper_m[2] > _HIGH_M
    if not tall or thing.category in _OPENINGS or thing.category.startswith(ROOM_PREFIX):
        return
    rows, columns = np.indices(floor.shape)
    xy = center_of(np.stack([rows, columns], -1))
    low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
    floor &= ~np.all((xy > low) & (xy < high), axis=-1)
