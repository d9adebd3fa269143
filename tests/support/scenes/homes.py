"""Checks of every generated building, as a list of faults."""

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from vlnpe.apartments import TrueScene
from vlnpe.apartments.building.plan import FloorPlan
from vlnpe.apartments.building.shell import wall_frame
from vlnpe.apartments.building.true_scene import TrueObject
from vlnpe.apartments.truth import covered_cells, true_floor
from vlnpe.formats.scene.freemap import Freemap

SHELL = {"wall", "floor", "ceiling", "window", "door", "door frame", "column", "stairs", "banister"}
SHELL |= {"railing"}
# A chair stands half under its table, which is no collision.
_SEATS = {"chair", "office chair"}
_TABLES = {"dining table", "conference table", "desk", "partition"}
_HANGING = {"curtain", "curtain rod", "picture", "mirror", "clock", "ceiling lamp", "coat rack"}
# Made to stand on or beside each other; a book on a nightstand may jut out over the bed.
_SETS = (
    {"tv stand", "television"},
    {"wall cupboard", "range hood"},
    {"bed", "nightstand"},
)
_LEAST_FREE_M2 = 0.4


def joined(plan: FloorPlan) -> bool:
    """Return whether doors lead from the first room to all others."""
    reached, todo = {0}, [0]
    while todo:
        for door in plan.doors_of(todo.pop()):
            if door.other_room >= 0 and door.other_room not in reached:
                reached.add(door.other_room)
                todo.append(door.other_room)
    return len(reached) == len(plan.rooms)


def assert_apart(plan: FloorPlan) -> None:
    """Assert that rooms have walls between them, and the openings of a wall do not overlap."""
    assert all(room.kind for room in plan.rooms)
    for a, b in combinations(plan.rooms, 2):
        gap = np.maximum(np.array(a.lower_m) - b.upper_m, np.array(b.lower_m) - a.upper_m)
        assert gap.max() >= plan.wall_m - 1e-9
    for o, p in combinations(plan.openings, 2):
        same_side = (o.room, o.axis, o.sign) == (p.room, p.axis, p.sign)
        assert not same_side or o.start_m >= p.end_m or p.start_m >= o.end_m


def exact_freemap(home: TrueScene, storey: int = 0, cell_m: float = 0.05) -> Freemap:
    """Free space of a storey by the exact triangles between 5 cm and 1.9 m above its floor."""
    plan = home.storeys[storey]
    grid, floor = true_floor(plan, cell_m)
    height = home.shape.corners[..., 2] - plan.floor_z_m
    # Walls bound the floor's mask already.
    walls = [k for k, o in enumerate(home.objects) if o.category in ("wall", "door", "window")]
    use = (height.max(1) > 0.05) & (height.min(1) < 1.9) & ~np.isin(home.face_object, walls)
    blocked = covered_cells(grid, home.shape.corners[use])
    z = np.where(floor, plan.floor_z_m, np.nan).astype(np.float32)
    return Freemap(grid, z, floor & ~blocked)


def unreachable(home: TrueScene, storey: int, radius_m: float) -> list[str]:
    """Rooms that a disc of `radius_m` cannot enter from the largest connected free floor."""
    space, plan = exact_freemap(home, storey), home.storeys[storey]
    labelled: Any = label(space.free(radius_m), np.ones((3, 3)))
    groups, _ = labelled
    main = np.bincount(groups[groups > 0]).argmax()
    rows, columns = np.indices(groups.shape)
    xy = space.grid.center_of(np.stack([rows, columns], -1))
    found = []
    for index, room in enumerate(plan.rooms):
        inside = np.all((xy > room.lower_m) & (xy < room.upper_m), axis=-1)
        area = np.count_nonzero(inside & (groups == main)) * space.grid.cell_m**2
        if area < _LEAST_FREE_M2:
            found.append(f"storey {storey}: {room.kind} {index}: {area:.2f} m² for r={radius_m}")
    return found


def _storey_of(home: TrueScene, thing: TrueObject) -> int:
    floors = [plan.floor_z_m for plan in home.storeys]
    return max(k for k, z in enumerate(floors) if thing.lower_m[2] > z - 0.1)


def _bounds(thing: TrueObject) -> NDArray[np.float64]:
    return np.array([thing.lower_m, thing.upper_m])


def faults(home: TrueScene) -> list[str]:
    """Return the faults of a building's furniture and doors."""
    found: list[str] = []
    things = [o for o in home.objects if o.category not in SHELL]
    storeys = [_storey_of(home, o) for o in things]
    boxes = [_bounds(o) for o in things]
    for thing, storey, box in zip(things, storeys, boxes, strict=True):
        plan, size = home.storeys[storey], 0.01
        inside = [
            np.all(box[0, :2] > np.array(r.lower_m) - size)
            and np.all(box[1, :2] < np.array(r.upper_m) + size)
            for r in plan.rooms
        ]
        if not any(inside):
            found.append(f"{thing.name} is not inside one room")
        low, high = box[:, 2] - plan.floor_z_m
        if low < -0.01 or high > plan.ceiling_m + 0.01:
            found.append(f"{thing.name} leaves its storey: {low:.2f} … {high:.2f} m")
        if low < 2.0 and high > 0.04:
            found += [f"{thing.name} stands in {w}" for w in _in_doorway(plan, box[:, :2])]
            found += [
                f"{thing.name} stands in the {block.kind}"
                for block in plan.blocks
                if _overlap(box[:, :2], block.rect()) > 0.01 and low < block.top_m
            ]
    for (a, s, p), (b, t, q) in combinations(zip(things, storeys, boxes, strict=True), 2):
        kinds = {a.category, b.category}
        paired = bool(kinds & _SEATS) and bool(kinds & _TABLES)
        loose = "rug" in kinds or bool(kinds & _HANGING) or kinds <= _TABLES or kinds in _SETS
        if s == t and not paired and not loose and _overlap(p, q) > 0.01:
            found.append(f"{a.name} overlaps {b.name}")
    for plan in home.storeys:
        for door in (o for o in plan.openings if o.kind in ("door", "passage")):
            if door.end_m - door.start_m < 0.8 or door.top_m < 2.0:
                found.append(f"narrow {door.kind}: {door.end_m - door.start_m:.2f} m")
        for index, room in enumerate(plan.rooms):
            ends = np.array([room.lower_m, room.upper_m])
            holds = any(
                _overlap(box[:, :2], ends) > 0.01 and home.storeys[s] is plan
                for box, s in zip(boxes, storeys, strict=True)
            )
            if not room.kind or not holds:
                found.append(f"room {index} ({room.kind!r}) is unlabelled or empty")
    found += [f"{o.name} has no category" for o in home.objects if not o.category]
    return found


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Least overlap of two boxes (2, D) along any axis [m]; negative if they are apart."""
    return float((np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])).min())


def _in_doorway(plan: FloorPlan, flat: NDArray[np.float64]) -> list[str]:
    """Doorways, with 0.4 m of floor before them, that a rectangle (2, 2) reaches into."""
    result = []
    for door in (o for o in plan.openings if o.kind != "window"):
        place = wall_frame(plan.rooms[door.room], door.axis, door.sign)
        p, q = place(door.start_m, -0.4, 0)[:2], place(door.end_m, plan.wall_m, 0)[:2]
        if _overlap(flat, np.stack([np.minimum(p, q), np.maximum(p, q)])) > 0.01:
            result.append(f"the {door.kind} of {plan.rooms[door.room].kind}")
    return result
