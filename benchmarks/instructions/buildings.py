"""Facts of generated buildings from their plans, without scan and repair."""

from pathlib import Path

import numpy as np

from vlnpe.apartments import building_config
from vlnpe.apartments.building.build import build_scene
from vlnpe.apartments.truth import true_floor
from vlnpe.formats.core.arrays import Mask
from vlnpe.formats.scene.bundle import LabeledObject, SceneBundle
from vlnpe.formats.scene.grid import GridSpec
from vlnpe.instruction_gen.facts import LevelFacts
from vlnpe.wayfinding.regions import ROOM_PREFIX, split_rooms

_CELL_M = 0.05
_LOW_M, _HIGH_M = 0.9, 1.7  # what fills these heights bounds the open floor, as walls do
_OPENINGS = frozenset(("door", "door frame", "window", "floor", "ceiling", "wall"))


def building(building_kind: str, seed: int) -> LevelFacts:
    """Return the ground floor of the building that `vlnpe scan SEED --kind KIND --exact` writes."""
    config = building_config(building_kind, seed)
    scene = build_scene(np.random.default_rng(seed), config, painted=False)
    plan = scene.plan
    low, high = plan.floor_z_m, plan.floor_z_m + plan.ceiling_m
    objects = [LabeledObject(o.name, o.category, o.lower_m, o.upper_m, 0) for o in scene.objects]
    counts: dict[str, int] = {}
    for room in plan.rooms:
        counts[room.kind] = counts.get(room.kind, 0) + 1
        name = f"Room_{room.kind}_{counts[room.kind]}"
        (x0, y0), (x1, y1) = room.lower_m, room.upper_m
        kind = ROOM_PREFIX + room.kind
        objects.append(LabeledObject(name, kind, (x0, y0, low), (x1, y1, high), 0))
    grid, floor = true_floor(plan, _CELL_M)
    for thing in objects:
        _stand(floor, grid, thing)
    bundle = SceneBundle(
        root=Path(),
        scene_id=f"{building_kind}-{seed}",
        source={},
        source_to_world=np.eye(4),
        habitat_to_world=np.eye(4),
        materials=(),
        labels=(),
        objects=tuple(objects),
        level_floor_z_m=(low,),
        generator={},
    )
    return LevelFacts.of(bundle, 0, split_rooms(floor, objects, grid))


def _stand(floor: Mask, grid: GridSpec, thing: LabeledObject) -> None:
    """Take what a tall thing covers from the open floor (rows, columns)."""
    tall = thing.lower_m[2] < _LOW_M and thing.upper_m[2] > _HIGH_M
    if not tall or thing.category in _OPENINGS or thing.category.startswith(ROOM_PREFIX):
        return
    rows, columns = np.indices(floor.shape)
    xy = grid.center_of(np.stack([rows, columns], -1))
    low, high = np.array(thing.lower_m[:2]), np.array(thing.upper_m[:2])
    floor &= ~np.all((xy > low) & (xy < high), axis=-1)
