"""The map seen so far as a level that the follower of instructions understands."""

from dataclasses import replace

from ....wayfinding.regions import split_rooms
from ..follower.world import World
from .seen_map import SeenMap

# What stands in a room tells its kind, but not these apart: rooms of the left are looked for among
# those of the right. A room in which nothing tells is taken for a passage.
_PASSAGE = "hallway"
_TAKEN_FOR = {
    "children's room": "bedroom",
    "nursery": "bedroom",
    "closet room": "bedroom",
    "office": "bedroom",
    "stairwell": _PASSAGE,
    "entrance hall": _PASSAGE,
    "lobby": _PASSAGE,
    "laundry room": "bathroom",
}


class SeenWorld(World):
    """A `World` whose rooms were recognized by what stands in them."""

    def regions_called(self, head: str) -> list[int]:
        """Return the regions that a name may refer to."""
        return super().regions_called(head) or super().regions_called(_TAKEN_FOR.get(head, head))


def seen_world(seen: SeenMap) -> SeenWorld:
    """Return the world of a map."""
    window = seen.window()
    objects = seen.objects()
    regions = split_rooms(seen.open_floor()[window], objects, seen.cut(window))
    regions = replace(regions, names=tuple(name or _PASSAGE for name in regions.names))
    return SeenWorld(seen.freemap(window), regions, objects)
