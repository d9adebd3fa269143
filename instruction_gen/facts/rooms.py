"""What people call the rooms of a level: by their labels, or by what stands in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...formats.scene.bundle import LabeledObject
from ...wayfinding.regions import RegionMap
from ..language.nouns import noun_of, room_of

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


def room_names(regions: RegionMap, things: Sequence[LabeledObject]) -> tuple[str, ...]:
    """Canonical name of each region, "" where neither a label nor a thing in it tells."""
    names = [room_of(name) for name in regions.names]
    inside: dict[int, set[str]] = {}
    for thing in things:
        middle = 0.5 * (np.array(thing.lower_m[:2]) + np.array(thing.upper_m[:2]))
        inside.setdefault(int(regions.at(middle)), set()).add(noun_of(thing.category))
    for k, name in enumerate(names):
        if not name:
            nouns = inside.get(k, set())
            names[k] = next((room for noun, room in _CALLED_BY.items() if noun in nouns), "")
    return tuple(names)
