"""Frontiers: where free floor meets the unseen, and how well they fit the next landmark.

After Yokoyama et al., "VLFM: Vision-Language Frontier Maps", 2024, and the improved VLMaps of
VLN-PE: near frontiers that fit the next landmark come first.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from skimage.measure import label

from ....instruction_gen.language.nouns import called
from ....wayfinding.regions import ROOM_OF_OBJECT
from ..follower.goals import SubGoal
from ..follower.world import World
from .seen_map import CELL_M, SeenMap

_SMALLEST = 4  # cells
_NEAR_M = 2.0  # of a frontier, where things hint at what is beyond


@dataclass(frozen=True)
class Frontier:
    """One opening to the unseen.

    Attributes:
        xy_m: (2,) where to stand, in the start frame.
        size_m: length of the border.
    """

    xy_m: NDArray[np.float64]
    size_m: float


def find_frontiers(seen: SeenMap, reachable: NDArray[np.bool_]) -> list[Frontier]:
    """Return the frontiers whose border touches `reachable` (R, C) cells."""
    unknown = ~seen.explored
    border = seen.free & binary_dilation(unknown) & ~binary_dilation(seen.obstacle)
    parts = np.asarray(label(border, connectivity=2))
    result = []
    near = binary_dilation(reachable, iterations=3)
    for k in range(1, int(parts.max()) + 1):
        cells = np.argwhere((parts == k) & near)
        if len(cells) < _SMALLEST:
            continue
        middle = cells[np.argmin(np.linalg.norm(cells - cells.mean(0), axis=1))]
        result.append(Frontier(seen.grid.center_of(middle), len(cells) * CELL_M))
    return result


def promise(frontier: Frontier, goal: SubGoal | None, world: World) -> float:
    """Return how well what is around a frontier fits the next sub-goal, −0.5 to 1.

    Things of the landmark's room near the frontier, or the frontier's own room, promise it; a
    room of another kind leads nowhere.
    """
    noun = goal.noun if goal is not None else None
    if noun is None or noun.kind not in ("object", "room", "door"):
        return 0.0
    here = int(world.region[world.cell(frontier.xy_m)])
    name = world.rooms[here] if here >= 0 else ""
    if noun.kind == "door":
        return 0.5 if name == "hallway" else 0.0
    if noun.kind == "room":
        promising = {world.rooms[k] for k in world.regions_called(noun.head)} | {noun.head}
    else:
        promising = {room for thing, room in ROOM_OF_OBJECT.items() if called(thing, noun.head)}
    beside = {
        ROOM_OF_OBJECT.get(thing.noun, "")
        for thing in world.things
        if np.linalg.norm(thing.middle_m - frontier.xy_m) < _NEAR_M
    } - {""}
    if promising & (beside | {name}):
        return 1.0
    return -0.5 if beside and promising else 0.0
