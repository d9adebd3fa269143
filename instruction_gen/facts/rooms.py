"""What people call the rooms of a level: by their labels, or by what stands in them."""

from collections.abc import Sequence

import numpy as np

from ...formats.scene.bundle import LabeledObject
from ...wayfinding.regions import RegionMap
from ..language.nouns import noun_of, room_of
from .geometry import Array, no_wall_between
from .named import NamedRoom

# A room without a name is called by the first of these things that stands in it.
_CALLED_BY = {
    "toilet": "bathroom",
    "bathtub": "bathroom",
    "shower": "bathroom",
    "bed": "bedroom",
    "refrigerator": "kitchen",
    "stove": "kitchen",
    "sofa": "living room",
}


_STEP_M = 0.15


def rooms_near(
    regions: RegionMap, names: Sequence[str], xy_m: Array, reach_m: float
) -> frozenset[str]:
    """Return the names of rooms with a place in open view within `reach_m` of a point (2,) [m]."""
    steps = np.arange(-reach_m, reach_m + 0.5 * _STEP_M, _STEP_M)
    offset = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    gap = np.linalg.norm(offset, axis=1)
    points, gap = xy_m + offset[gap <= reach_m], gap[gap <= reach_m]
    region = regions.at(points)
    points, gap, region = points[region >= 0], gap[region >= 0], region[region >= 0]
    seen = no_wall_between(np.broadcast_to(xy_m, points.shape), points, gap, regions)
    return frozenset(str(names[int(k)]) for k in np.unique(region[seen])) - {""}


def room_names(
    regions: RegionMap, things: Sequence[LabeledObject], named: Sequence[NamedRoom] = ()
) -> tuple[str, ...]:
    """Return the canonical name of each region, "" if nothing identifies it.

    Args:
        regions: of a level.
        things: on it; they identify a region without a name.
        named: rooms of the level that have no label; their names go before what stands in them.
    """
    names = [room_of(name) for name in regions.names]
    for room in named:
        if (k := int(regions.at(room.xy_m))) >= 0:
            names[k] = room_of(room.name) or names[k]
    inside: dict[int, set[str]] = {}
    for thing in things:
        middle = 0.5 * (np.array(thing.lower_m[:2]) + np.array(thing.upper_m[:2]))
        inside.setdefault(int(regions.at(middle)), set()).add(noun_of(thing.category))
    for k, name in enumerate(names):
        if not name:
            nouns = inside.get(k, set())
            names[k] = next((room for noun, room in _CALLED_BY.items() if noun in nouns), "")
    return tuple(names)


def nouns_inside(
    regions: RegionMap, nouns: Sequence[str], low_m: Array, high_m: Array
) -> tuple[frozenset[str], ...]:
    """Return for each region the nouns of the boxes (N, 2) [m] whose middle is in it."""
    inside: list[set[str]] = [set() for _ in regions.names]
    for noun, region in zip(nouns, regions.at(0.5 * (low_m + high_m)).tolist(), strict=True):
        if region >= 0:
            inside[region].add(noun)
    return tuple(frozenset(nouns) for nouns in inside)


def rooms_of_boxes(
    regions: RegionMap, names: Sequence[str], low_m: Array, high_m: Array
) -> tuple[str, ...]:
    """Return the room of each box (N, 2) [m]: that of most of a few places in and around it."""
    result = []
    for low, high in zip(low_m - 0.25, high_m + 0.25, strict=True):
        xs, ys = np.linspace(low, high, 5).T
        found = regions.at(np.stack(np.meshgrid(xs, ys), axis=-1)).ravel()
        found = found[found >= 0]
        result.append(names[int(np.bincount(found).argmax())] if len(found) else "")
    return tuple(result)
